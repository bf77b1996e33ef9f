"""A solid is found in images from nothing."""

import math

import numpy as np
import pytest
from synthetic import (
    hexagonal_prism,
    in_all_images,
    in_camera,
    odd_rig,
    paper_box,
    pose,
    project,
    quaternion_vector,
    random_poses_in_view,
    render,
    rotation,
)

from mffdrake.recognition import (
    Acquisition,
    AcquisitionParameters,
    BorderRefiner,
    Camera,
    CameraRig,
    Matcher,
    ParameterError,
    SearchModel,
    SearchRange,
    SolidModel,
)
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.solid.symmetry import find_look_alikes, find_symmetries

_borders = pytest.importorskip("mffdrake.recognition.refinement.borders")


def wedge(length=0.18, width=0.12, height=0.1):
    """A prism over a right triangle, with five faces of five hues."""
    x, y, z = length, width, 0.5 * height
    vertices = [(0, 0, -z), (x, 0, -z), (0, y, -z), (0, 0, z), (x, 0, z), (0, y, z)]
    faces = [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)]
    return SolidModel(np.array(vertices) - [x / 3, y / 3, 0.0], faces, np.arange(5) * 1.2566)


def six_colored_box():
    box = paper_box()
    return SolidModel(box.vertices, box.faces, np.radians(60.0 * np.arange(6)))


BOX, SIX, PRISM, WEDGE = paper_box(), six_colored_box(), hexagonal_prism(), wedge()
RIG, FINE = CameraRig.stereo(width=320, height=240), CameraRig.stereo()
EVERYWHERE = SearchRange(eps1=(-1.0, 1.0), eps2=(-1.0, 1.0), eps3=(-1.0, 1.0))


def acquisition(solid, rig=RIG, search_range=None, **parameters):
    return Acquisition(
        BorderRefiner(Matcher(SearchModel(solid), rig)),
        SearchRange() if search_range is None else search_range,
        AcquisitionParameters(**parameters),
    )


def any_pose(rng, solid, rig):
    """A pose in view, in any orientation."""
    while True:
        q = rng.normal(size=4)
        q *= np.sign(q[0]) / np.linalg.norm(q)
        psi = pose((*rng.uniform([-0.1, 0.05, 0.7], [0.1, 0.25, 0.9]),), q[1:])
        if in_all_images(solid, psi, rig):
            return psi


def some_pose(rng, solid, rig):
    """A pose of the usual search range, in view."""
    return random_poses_in_view(rng, solid, rig, 1)[0]


def errors(found, truth, solid):
    """Distance [mm] and angle [deg], modulo turns that bring all colors onto themselves."""
    truths = [truth, *find_symmetries(solid).turns.of(truth)]
    angle, best = min((float(rotation_angle(found[3:], t[3:])), k) for k, t in enumerate(truths))
    return 1e3 * np.linalg.norm(found[:3] - truths[best][:3]), math.degrees(angle)


def blotch(images, rig, rng, count, solid, psi):
    """Draws discs of the solid's colors into the background, behind the solid."""
    shown = [(im != 128).any(axis=-1) for im in images]
    palette = np.unique(
        np.concatenate([im[on] for im, on in zip(images, shown, strict=True)]), axis=0
    )
    for _ in range(count):
        p = np.array([*rng.uniform(-0.45, 0.45, 2), rng.uniform(1.2, 1.6)])
        color, radius = palette[rng.integers(len(palette))], rng.uniform(0.03, 0.08)
        for image, on, camera in zip(images, shown, rig.cameras, strict=True):
            p_K = camera.R_CK.T @ (p - camera.p_CK)
            u, v = project(camera, p_K[None])[0]
            y, x = np.ogrid[: camera.height, : camera.width]
            disc = np.hypot(x - u, y - v) < radius * camera.fx / p_K[2]
            image[disc & ~on] = color
    return images


def first_errors(solid, search_range, draw, seeds, rig=RIG, blobs=0):
    """Of the first candidates: errors, how much they explain, and errors once refined."""
    searcher, found = acquisition(solid, rig, search_range), []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        psi = draw(rng, solid, rig)
        images = render(solid, psi, rig, supersampling=3)
        images = blotch(images, rig, rng, blobs, solid, psi)
        scene = searcher.matcher.scene(images)
        first = searcher.search(scene, [], seed, rng)[0]
        refined = searcher.refiner.refine_scene(first.pose, scene)
        assert refined.converged
        off = [errors(one, psi, solid) for one in (first.pose, refined.pose)]
        found.append((*off[0], first.explained.share, *off[1]))
    return np.array(found).T


CASES = {
    "box": (BOX, None, some_pose),
    "six": (SIX, EVERYWHERE, any_pose),
    "prism": (PRISM, EVERYWHERE, any_pose),
    "wedge": (WEDGE, EVERYWHERE, any_pose),
}


@pytest.mark.parametrize("case", CASES)
def test_the_first_candidate_is_the_true_pose(case):
    # From some sides the wedge is a rectangle that tells too little in few pixels.
    rig = FINE if case == "wedge" else RIG
    distance, angle, explained, *refined = first_errors(*CASES[case], range(200, 220), rig)
    assert distance.max() < 5.0 and angle.max() < 2.0
    assert explained.min() > 0.7
    assert refined[0].max() < 1.0 and refined[1].max() < 0.5


@pytest.mark.parametrize("case", ["box", "prism"])
def test_it_is_found_before_ten_things_of_its_colors(case):
    distance, angle, *_ = first_errors(*CASES[case], range(220, 230), blobs=10)
    assert distance.max() < 3.0 and angle.max() < 2.0


@pytest.mark.parametrize(
    "rig",
    [CameraRig(RIG.cameras[:1]), odd_rig("none", "none"), odd_rig("barrel")],
    ids=["alone", "three", "barrel"],
)
def test_every_rig_finds_it(rig):
    distance, angle, *_ = first_errors(BOX, None, some_pose, range(230, 236), rig)
    assert distance.max() < (8.0 if len(rig.cameras) == 1 else 2.0)
    assert angle.max() < (1.0 if len(rig.cameras) == 1 else 0.5)


def test_candidates_come_in_order_and_are_what_is_kept():
    searcher = acquisition(BOX, kept=4)
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    scene = searcher.matcher.scene(render(BOX, psi, RIG, supersampling=3))
    found = searcher.search(scene, [], 0, np.random.default_rng(0))
    assert 1 <= len(found) <= 4
    shares = [candidate.explained.share for candidate in found]
    assert shares == sorted(shares, reverse=True)
    for candidate in found:
        assert candidate.explained == searcher.explained(candidate.pose, scene)
    again = searcher.search(scene, [], 0, np.random.default_rng(0))
    np.testing.assert_array_equal([c.pose for c in found], [c.pose for c in again])


def test_where_a_glance_tells_no_more_is_tried():
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    images = render(BOX, psi, RIG, supersampling=3)
    both = acquisition(BOX, proposals=160, tried=24, drawn=12, kept=8, glance=0.25)
    glance = acquisition(BOX, proposals=40, tried=6, drawn=3, kept=2, glance=1.0)

    def search(searcher, seen):
        found = searcher.search(searcher.matcher.scene(seen), [], 0, np.random.default_rng(0))
        return [candidate.pose.tolist() for candidate in found], found[0].explained.share

    poses, share = search(both, images)
    assert share >= both.parameters.sure
    assert poses == search(glance, images)[0]
    # Half of it hidden, so that no pose is sure
    hidden = [image.copy() for image in images]
    for image in hidden:
        image[:, : image.shape[1] // 2] = 128
    poses, share = search(both, hidden)
    first = search(glance, hidden)[0]
    assert share < both.parameters.sure
    assert len(poses) > len(first) and all(one in poses for one in first)


def test_nothing_is_found_where_there_is_nothing():
    searcher = acquisition(BOX)
    grey = [np.full((240, 320, 3), 128, dtype=np.uint8)] * 2
    scene = searcher.matcher.scene(grey)
    known = pose((0.0, 0.15, 0.8))
    rng = np.random.default_rng(0)
    assert searcher.search(scene, [], 0, rng) == []
    assert searcher.search(scene, [known], 0, rng) == []
    assert searcher.approach([known], scene) == []
    assert searcher.explained(known, scene).share == 0.0


def test_a_known_pose_is_tried_beyond_the_search_range():
    elsewhere = SearchRange(x=(0.4, 0.5), y=(0.4, 0.5))
    searcher = acquisition(BOX, search_range=elsewhere)
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    scene = searcher.matcher.scene(render(BOX, psi, RIG, supersampling=3))
    near = psi + [0.01, -0.01, 0.01, 0.03, -0.03, 0.02]
    rng = np.random.default_rng(0)
    assert all(errors(c.pose, psi, BOX)[0] > 100.0 for c in searcher.search(scene, [], 0, rng))
    found = searcher.search(scene, [near], 0, rng)
    assert errors(found[0].pose, psi, BOX) < (2.0, 0.5)


def test_steps_lead_from_centimeters_and_tens_of_degrees_away():
    searcher, rng, arrived = acquisition(BOX), np.random.default_rng(240), 0
    for psi in random_poses_in_view(rng, BOX, RIG, 20):
        scene = searcher.matcher.scene(render(BOX, psi, RIG, supersampling=3))
        axis, away = rng.normal(size=(2, 3))
        R = turned(psi, axis, 12.0)
        start = pose(psi[:3] + 0.02 * away / np.linalg.norm(away), quaternion_vector(R))
        found = searcher.approach([start], scene)
        if found:
            distance, angle = errors(found[0].pose, psi, BOX)
            arrived += distance < 2.0 and angle < 0.5
    assert arrived >= 16


def turned(psi, axis, angle_deg):
    """Rotation matrix of a pose turned about an axis of the rig's frame."""
    half = math.sin(math.radians(0.5 * angle_deg))
    return rotation(half * np.asarray(axis) / np.linalg.norm(axis)) @ rotation(psi[3:])


# What a pose explains


@pytest.mark.parametrize("solid", [BOX, PRISM, WEDGE], ids=["box", "prism", "wedge"])
def test_the_true_pose_explains_its_borders_and_a_tilted_one_does_not(solid):
    searcher, rng, shares = acquisition(solid, FINE), np.random.default_rng(250), []
    for k in range(16):
        psi = any_pose(rng, solid, FINE)
        images = render(solid, psi, FINE, supersampling=(1, 4)[k % 2])
        scene = searcher.matcher.scene(images)
        shares.append(searcher.explained(psi, scene).share)
        tilted = pose(psi[:3], quaternion_vector(turned(psi, rng.normal(size=3), 12.0)))
        assert searcher.explained(tilted, scene).share < 0.5
    # Near an acute corner, as the wedge has them, a face is too narrow to show its borders.
    assert min(shares) > (0.75 if solid is WEDGE else 0.9)
    assert np.median(shares) > 0.95


def test_a_box_turned_by_a_quarter_explains_little():
    cube = SolidModel.box((0.15, 0.15, 0.15), np.radians([0.0, 120.0, 240.0]))
    searcher = acquisition(cube)
    for eps in ((0.25, 0.35, 0.1), (-0.3, 0.3, 0.1), (-0.25, -0.4, 0.2)):
        psi = pose((0.0, 0.12, 0.8), eps)
        scene = searcher.matcher.scene(render(cube, psi, RIG, supersampling=3))
        # All cameras see three faces well.
        for camera in RIG.cameras:
            R, p = in_camera(psi, camera)
            ahead = -(cube.centers @ R.T + p)
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            assert (np.einsum("fk,fk->f", ahead, cube.normals @ R.T) > 0.15).sum() == 3
        assert searcher.explained(psi, scene).share > 0.85
        others = find_look_alikes(cube).of(psi)
        assert len(others) == 20
        for other in others:  # The same edges, but other colors
            assert searcher.explained(other, scene).share < 0.7


def test_borders_are_counted_by_brute_force():
    """On a face seen straight on, every row and column crosses its sides where it should."""
    plate = SolidModel.box((0.20, 0.15, 0.02), np.radians([0.0, 120.0, 240.0]))
    camera = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
    searcher = acquisition(plate, CameraRig((camera,)))
    rules, psi = searcher.refiner.rules, pose((0.0, 0.0, 0.61))
    look = _borders.Stage(3, 1, 0)
    images = render(plate, psi, searcher.matcher.rig)
    scene = searcher.matcher.scene(images)
    ((shown, sought),) = _borders.count_explained(psi, scene, rules, look, 1.0)
    # Its front is 0.6 m ahead, 100 x 75 px; four pixels are left out at both ends.
    assert sought == shown == 2 * (100 - 8) + 2 * (75 - 8 + 1)
    # A border that lies farther off than the tolerance is not explained, but sought.
    aside = psi + [2.4 * 0.6 / 300.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    ((shown, as_many),) = _borders.count_explained(aside, scene, rules, look, 1.0)
    assert as_many == pytest.approx(sought, abs=2) and shown == pytest.approx(184, abs=10)
    ((shown, _),) = _borders.count_explained(aside, scene, rules, look, 3.0)
    assert shown == pytest.approx(as_many, abs=10)


@pytest.mark.parametrize("shift", [-0.35, 0.35])
def test_rows_out_of_the_image_do_not_count(shift):
    searcher = acquisition(BOX, CameraRig(RIG.cameras[:1]))
    psi = pose((shift, 0.02, 0.7), (0.15, 0.25, 0.1))
    scene = searcher.matcher.scene(render(BOX, psi, searcher.matcher.rig, supersampling=4))
    assert not in_all_images(BOX, psi, searcher.matcher.rig)
    counts = _borders.count_explained(
        psi, scene, searcher.refiner.rules, _borders.Stage(3, 1, 0), 1.0
    )
    whole = pose((0.0, 0.02, 0.7), (0.15, 0.25, 0.1))
    scene_of_all = searcher.matcher.scene(render(BOX, whole, searcher.matcher.rig))
    all_counts = _borders.count_explained(
        whole, scene_of_all, searcher.refiner.rules, _borders.Stage(3, 1, 0), 1.0
    )
    assert 30 < counts[0, 1] < 0.9 * all_counts[0, 1]
    assert counts[0, 0] > 0.85 * counts[0, 1]
    assert searcher.explained(psi, scene).share > 0.85


def test_few_rows_explain_little():
    searcher = acquisition(BOX, least_rows=500)
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    scene = searcher.matcher.scene(render(BOX, psi, RIG, supersampling=3))
    counts = _borders.count_explained(
        psi, scene, searcher.refiner.rules, _borders.Stage(3, 4, 0), 1.0
    ).sum(axis=0)
    assert counts[1] < 500
    assert searcher.explained(psi, scene).share == pytest.approx(counts[0] / 500.0)
    assert acquisition(BOX).explained(psi, scene).share == pytest.approx(counts[0] / counts[1])


@pytest.mark.parametrize(
    "wrong", [{"proposals": 0}, {"windows": ()}, {"found": 1.1}, {"kept": 0}, {"tolerance": 0.0}]
)
def test_parameters_are_checked(wrong):
    with pytest.raises((ParameterError, ValueError), match=next(iter(wrong))):
        AcquisitionParameters(**wrong)
