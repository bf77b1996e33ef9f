"""Sub-pixel refinement of poses from color borders, on synthetic images."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from synthetic import (
    arc_poses,
    hexagonal_prism,
    in_camera,
    odd_camera,
    odd_rig,
    paper_box,
    pose,
    project,
    random_poses_in_view,
    render,
    rotation,
    tetrahedron,
    unproject,
)

from mffdrake.recognition import (
    BorderRefiner,
    CameraRig,
    Generation,
    Matcher,
    MatchingParameters,
    NearStart,
    NoRefinement,
    OneStepGaTracker,
    Refinement,
    RefinementParameters,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.poses.pose import (
    compose_quaternion_vectors,
    quaternion_vector,
    rotation_angle,
    transform_from_pose,
)
from mffdrake.recognition.poses.pose_motion import rotate_by, transport_pose
from mffdrake.recognition.refinement.outcome import Outcome

_borders = pytest.importorskip("mffdrake.recognition.refinement.borders")
_edge_lines = pytest.importorskip("mffdrake.recognition.refinement.edge_lines")
_refinement = pytest.importorskip("mffdrake.recognition.refinement.refining")
_rotations = pytest.importorskip("mffdrake.recognition.poses.rotations")

BOX, PRISM, TETRAHEDRON = paper_box(), hexagonal_prism(), tetrahedron()
SOLIDS = {"box": BOX, "prism": PRISM, "tetrahedron": TETRAHEDRON}
RIG = CameraRig.stereo()
MATCHER = Matcher(SearchModel(BOX), RIG)
REFINER = BorderRefiner(MATCHER)
TRUTH = pose((0.02, 0.15, 0.78), (0.06, 0.12, -0.05))
ALIASED, ANTIALIASED = 1, 6
"""Rays a pixel along each side: without blended pixels, and with."""

IMAGES = {sampling: render(BOX, TRUTH, RIG, supersampling=sampling) for sampling in (1, 6)}
NEES_OF_20 = 152.2 / 20.0
"""The 97.5 % point of chi square with 120 degrees of freedom, a run."""


def displaced(psi, rng, shift=0.003, turn_deg=1.0):
    """A pose off by a distance [m] and an angle, in random directions."""
    d, a = rng.normal(size=(2, 3))
    turn = rotate_by(math.radians(turn_deg) * a / np.linalg.norm(a))
    position = psi[:3] + shift * d / np.linalg.norm(d)
    return np.concatenate([position, compose_quaternion_vectors(turn, psi[3:])])


def noisy(images, rng, deviation):
    """Images with normal noise [grey levels]."""
    return tuple(
        np.clip(np.rint(im + rng.normal(0.0, deviation, im.shape)), 0, 255).astype(np.uint8)
        for im in images
    )


def errors(refined, truth):
    """Distance [mm] and angle [deg]."""
    distance = 1e3 * np.linalg.norm(refined[:3] - truth[:3])
    return distance, math.degrees(rotation_angle(refined[3:], truth[3:]))


def nees(result, truth):
    """Normalized estimation error squared."""
    error = truth - result.pose
    return error @ np.linalg.solve(result.covariance, error)


def root_mean_square(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def struct_of(solid, rig=RIG):
    """The solid as compiled functions take it."""
    return Matcher(SearchModel(solid), rig).struct


def lines_at(psi, solid=BOX, rig=RIG):
    """All lines."""
    black = [np.zeros((c.height, c.width, 3), dtype=np.uint8) for c in rig.cameras]
    return _edge_lines.edge_lines(np.asarray(psi), struct_of(solid, rig), rig.views(black))


def borders_at(psi, images, solid=BOX, rig=RIG, **parameters):
    """Lines and borders at a pose, on every row."""
    p = RefinementParameters(**parameters)
    rules = _borders.BorderRules(
        p.blend, p.end_margin, p.min_cosine, p.min_contrast, p.max_mismatch, p.min_borders,
        p.border_error, p.edge_error,
    )  # fmt: skip
    lines = lines_at(psi, solid, rig)
    scene = Matcher(SearchModel(solid), rig).scene(images)
    borders, sought = _borders.find_borders(
        psi, lines, scene, rules, _borders.Stage(p.fine_window, 1, 1)
    )
    assert sought.sum() >= len(borders)
    return lines, borders


def cross(camera, line, along):
    """Where a row (column) crosses a line, and the normalized coordinates of the place."""
    across, x, y = np.empty((3, 1))
    _edge_lines.cross(camera.eye, line, np.array([along]), across, x, y)
    return across[0], x[0], y[0]


def distances(lines, borders, rig=RIG):
    """From the lines to borders (or jumps) on their rows or columns [px]."""
    num_edges = len(lines) // len(rig.cameras)
    return np.array(
        [
            border["across"]
            - cross(
                rig.cameras[border["line"] // num_edges], lines[border["line"]], border["along"]
            )[0]
            for border in borders
        ]
    )


# Geometry


RIGS = {
    "pair": RIG,
    "plumb_bob": odd_rig("barrel"),
    "equidistant": odd_rig("equidistant"),
    "three": odd_rig("rational", "pincushion"),
    "alone": CameraRig((odd_camera("barrel"),)),
}
rigs = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


@rigs
@pytest.mark.parametrize("name", SOLIDS)
def test_lines_are_the_edges_projections(name, rig):
    solid, rng = SOLIDS[name], np.random.default_rng(1)
    for psi in random_poses_in_view(rng, solid, rig, 3):
        lines = lines_at(psi, solid, rig)
        assert len(lines) == len(rig.cameras) * len(solid.edges)
        assert lines["seen"].all()
        for n, line in enumerate(lines):
            k, edge = divmod(n, len(solid.edges))
            camera = rig.cameras[k]
            (first, last), (R_KM, p_KM) = solid.vertices[solid.edges[edge]], in_camera(psi, camera)
            shares = np.array([[0.0], [0.3], [1.0]])
            points = (1.0 - shares) * first + shares * last
            for u, v in project(camera, points @ R_KM.T + p_KM):
                along, across = (v, u) if line["rows"] else (u, v)
                found, x, y = cross(camera, line, along)
                # A line seen nearly end-on may be short: no longer than what rounding makes of it.
                assert found == pytest.approx(across, abs=1e-7)
                np.testing.assert_allclose((x, y), unproject(camera, u, v), rtol=0, atol=1e-9)


@rigs
def test_slopes_are_the_numerical_ones_at_the_middle_of_the_lines(rig):
    for psi in random_poses_in_view(np.random.default_rng(30), PRISM, rig, 3):
        lines = lines_at(psi, PRISM, rig)
        for n, line in enumerate(lines):
            if abs(line["last"] - line["first"]) < 1.0:
                continue
            camera = rig.cameras[n // len(PRISM.edges)]
            middle = 0.5 * np.array([line["x0"] + line["x1"], line["y0"] + line["y1"]])
            u, v = project(camera, np.array([[*middle, 1.0]]))[0]
            at, h = (v if line["rows"] else u), 1e-3
            after, before = (cross(camera, line, at + step)[0] for step in (h, -h))
            assert line["slope"] == pytest.approx((after - before) / (2.0 * h), abs=1e-5)
            # Ends tell which is nearer; a bent line may be a little steeper at its middle.
            assert abs(line["slope"]) < (1.0 + 1e-9 if rig is RIG else 1.3)


def test_a_line_behind_the_camera_is_none():
    lines = lines_at(pose((0.0, 0.0, 0.05)))
    behind = BOX.vertices[:, 2] + 0.05 < 0.0
    expected = ~behind[BOX.edges].any(axis=1)
    assert 0 < expected.sum() < 12
    np.testing.assert_array_equal(lines["seen"], np.tile(expected, 2))


def test_a_move_turns_the_target_about_its_origin_by_a_vector_of_the_cameras_frame():
    rng = np.random.default_rng(2)
    for _ in range(20):
        step = rng.normal(size=6) * [0.1, 0.1, 0.1, 0.8, 0.8, 0.8]
        moved = _rotations.move(TRUTH, step)
        np.testing.assert_allclose(moved[:3], TRUTH[:3] + step[:3])
        expected = compose_quaternion_vectors(rotate_by(step[3:]), TRUTH[3:])
        np.testing.assert_allclose(moved[3:], expected, atol=1e-12)
    np.testing.assert_array_equal(_rotations.move(TRUTH, np.zeros(6))[:3], TRUTH[:3])


def test_what_has_changed_since_the_start_is_told():
    samples, matching = MATCHER.structs[1:]
    start, scene = displaced(TRUTH, np.random.default_rng(1)), MATCHER.scene(IMAGES[ALIASED])
    (_, pose, C, *_), changed = _refinement.refine(
        start, scene, samples, matching, REFINER.rules, REFINER.stages
    )
    change = _refinement.Change(*changed)
    assert change.shift == pytest.approx(np.linalg.norm(pose[:3] - start[:3]))
    assert change.turn == pytest.approx(float(rotation_angle(pose[3:], start[3:])))
    fitness = MATCHER.fitness([pose, start], IMAGES[ALIASED])
    np.testing.assert_array_equal([change.fitness, change.before], fitness)
    h = 1e-6
    J = np.array([(_rotations.move(pose, s) - _rotations.move(pose, -s)) for s in h * np.eye(6)]).T
    J /= 2.0 * h
    np.testing.assert_allclose(change.covariance, J @ C @ J.T, rtol=1e-6, atol=1e-14)
    np.testing.assert_array_equal(
        change.covariance, REFINER.refine(start, IMAGES[ALIASED]).covariance
    )


@rigs
@pytest.mark.parametrize("name", SOLIDS)
def test_the_jacobian_is_the_numerical_derivative(name, rig):
    solid, rng, h = SOLIDS[name], np.random.default_rng(3), 1e-6
    views = rig.views([np.zeros((c.height, c.width, 3), dtype=np.uint8) for c in rig.cameras])
    for psi in random_poses_in_view(rng, solid, rig, 2):
        lines = lines_at(psi, solid, rig)
        moved = {}
        for i, sign in itertools.product(range(6), (1.0, -1.0)):
            moved[i, sign], step = lines.copy(), np.zeros(6)
            step[i] = sign * h
            assert _edge_lines.move_lines(
                moved[i, sign],
                _rotations.move(psi, step),
                struct_of(solid, rig),
                views,
                True,
            )
        for n, line in enumerate(lines):
            if abs(line["last"] - line["first"]) < 1.0:
                continue
            camera = rig.cameras[n // len(solid.edges)]
            at = line["first"] + rng.uniform(0.1, 0.9) * (line["last"] - line["first"])
            _, x, y = cross(camera, line, at)
            J = np.empty((1, 6))
            _edge_lines.cross_jacobians(camera.eye, line, np.array([x]), np.array([y]), psi, J)
            for i in range(6):
                after, before = (cross(camera, moved[i, sign][n], at)[0] for sign in (1.0, -1.0))
                assert J[0, i] == pytest.approx((after - before) / (2.0 * h), rel=2e-5, abs=2e-3)


def test_the_solver_solves():
    rng = np.random.default_rng(4)
    A, b = rng.normal(size=(10, 6)), rng.normal(size=6)
    L = np.zeros((6, 6))
    assert _refinement.factor(A.T @ A, L)
    np.testing.assert_allclose(_refinement.solve(L, b), np.linalg.solve(A.T @ A, b))
    assert not _refinement.factor(A[:5].T @ A[:5], L)


# Borders


@pytest.mark.parametrize(
    ("name", "sampling", "rig"),
    [
        *itertools.product(SOLIDS, (ALIASED, ANTIALIASED), ["pair"]),
        ("box", ALIASED, "plumb_bob"), ("prism", 4, "equidistant"),
    ],
)  # fmt: skip
def test_borders_lie_on_the_edges_without_bias(name, sampling, rig):
    rig = RIGS[rig]
    solid, rng = SOLIDS[name], np.random.default_rng(5)
    found, signs = [], []
    for psi in random_poses_in_view(rng, solid, rig, 12):
        images = render(solid, psi, rig, supersampling=sampling)
        lines, borders = borders_at(psi, images, solid, rig)
        # Outward is away from the solid's middle.
        r = distances(lines, borders, rig)
        found.append(r)
        for n in np.unique(borders["line"]):
            line, camera = lines[n], rig.cameras[n // len(solid.edges)]
            middle, across = _middle(psi, solid, camera, line)
            beyond = cross(camera, line, middle)[0] > across
            count = (borders["line"] == n).sum()
            signs.append(np.full(count, 1.0 if beyond else -1.0))
    found, signs = np.concatenate(found), np.concatenate(signs)
    assert len(found) > 3000
    good = np.abs(found) < 0.6
    assert good.mean() > 0.99
    # Neither to the right or down, nor outward
    assert abs(found[good].mean()) < 0.01
    assert abs((signs * found)[good].mean()) < 0.01
    # Rounding to whole pixels is even over one; six samples a side leave at most a sixth of it.
    spread = sampling * found[good].std() * math.sqrt(12.0)
    assert spread < 1.05
    assert sampling > 1 or spread > 0.95


def _middle(psi, solid, camera, line):
    """Where the solid's middle lies in the image, along and across a line's rows."""
    R_KM, p_KM = in_camera(psi, camera)
    u, v = project(camera, (solid.vertices.mean(axis=0) @ R_KM.T + p_KM)[None])[0]
    return (v, u) if line["rows"] else (u, v)


def test_jumps_of_a_hard_border_lie_within_half_a_row():
    seen = []
    for psi in arc_poses(9) + [0.001, 0.002, 0.003, 0.002, 0.0, 0.004]:
        lines, borders = borders_at(psi, render(BOX, psi, RIG))
        jumps = _borders.find_jumps(borders, lines)
        slope = lines["slope"][jumps["line"]]
        seen.append(distances(lines, jumps) / slope)
        assert (jumps["within"] == 1.0).all()  # no row wavers
    seen = np.concatenate(seen)
    assert len(seen) > 100
    assert np.abs(seen).max() < 0.5 + 1e-6
    assert seen.std() == pytest.approx(1.0 / math.sqrt(12.0), rel=0.15)


def test_neighbors_of_the_same_hue_have_no_border():
    same = SolidModel(BOX.vertices, BOX.faces, np.full(6, 2.0))
    psi = pose((0.0, 0.155, 0.8), (0.1, 0.2, 0.1))
    _, borders = borders_at(psi, render(same, psi, RIG), same)
    looking = (same.normals @ rotation(psi[3:]).T * psi[:3]).sum(axis=1) < 0
    pairs = looking[same.edge_faces[borders["line"] % 12]]
    assert len(borders) > 200
    assert (pairs.sum(axis=1) == 1).all()


def test_borders_of_another_color_on_the_inside_do_not_count():
    other = SolidModel(BOX.vertices, BOX.faces, BOX.hues + 0.8)
    _, borders = borders_at(TRUTH, render(other, TRUTH, RIG))
    assert len(borders) == 0


# Accuracy


@pytest.mark.parametrize(
    ("sampling", "noise", "position", "angle"),
    [
        (ALIASED, 0, 0.30, 0.08),
        (ALIASED, 5, 0.30, 0.08),
        (ANTIALIASED, 0, 0.1, 0.03),
        (ANTIALIASED, 5, 0.2, 0.06),
    ],
)
@pytest.mark.parametrize("name", SOLIDS)
def test_accuracy_from_three_millimeters_and_one_degree_off(name, sampling, noise, position, angle):
    solid, rng = SOLIDS[name], np.random.default_rng(11)
    refiner = BorderRefiner(Matcher(SearchModel(solid), RIG))
    found = []
    for psi in random_poses_in_view(rng, solid, RIG, 20):
        images = noisy(render(solid, psi, RIG, supersampling=sampling), rng, noise)
        result = refiner.refine(displaced(psi, rng), images)
        if result.converged:
            found.append(errors(result.pose, psi))
    assert len(found) >= 19
    assert (root_mean_square(found) < [position, angle]).all()


@pytest.mark.parametrize(("width", "limit"), [(320, 1.5), (1280, 0.1)])
def test_image_sizes(width, limit):
    rig = CameraRig.stereo(width=width, height=width * 3 // 4, fov_y=math.radians(45))
    refiner, rng = BorderRefiner(Matcher(SearchModel(BOX), rig)), np.random.default_rng(12)
    found = []
    for psi in random_poses_in_view(rng, BOX, rig, 6):
        result = refiner.refine(displaced(psi, rng), render(BOX, psi, rig))
        assert result.converged
        found.append(errors(result.pose, psi)[0])
    assert root_mean_square(found) < limit


def test_an_alpha_channel_makes_no_difference():
    start = displaced(TRUTH, np.random.default_rng(13))
    plain = REFINER.refine(start, IMAGES[ALIASED])
    alpha = [np.dstack([im, np.full(im.shape[:2], 255, np.uint8)]) for im in IMAGES[ALIASED]]
    np.testing.assert_array_equal(REFINER.refine(start, alpha).pose, plain.pose)


def test_the_result_hardly_depends_on_the_start():
    rng = np.random.default_rng(14)
    results = [REFINER.refine(displaced(TRUTH, rng), IMAGES[ALIASED]) for _ in range(10)]
    assert all(result.converged for result in results)
    spread = np.std([result.pose for result in results], axis=0)
    assert (spread[:3] < 3e-5).all() and (spread[3:] < 1e-4).all()


def test_aliasing_tells_blended_images():
    assert REFINER.refine(TRUTH, IMAGES[ALIASED]).aliasing == 1.0
    smooth = REFINER.refine(TRUTH, IMAGES[ANTIALIASED])
    assert smooth.aliasing < 0.2 and smooth.num_jumps == 0


@pytest.mark.parametrize("images", IMAGES)
def test_noise_changes_neither_the_aliasing_nor_what_is_expected(images):
    rng = np.random.default_rng(5)
    clear = REFINER.refine(TRUTH, IMAGES[images])
    noisy = [
        np.clip(np.rint(image + rng.normal(0.0, 5.0, image.shape)), 0, 255).astype(np.uint8)
        for image in IMAGES[images]
    ]
    found = REFINER.refine(TRUTH, noisy)
    assert found.aliasing == pytest.approx(clear.aliasing, abs=0.06)
    assert found.expected_residual == pytest.approx(clear.expected_residual, rel=0.05)
    assert found.residual < 1.3 * found.expected_residual


@pytest.mark.parametrize("color", [(90, 90, 90), (200, 180, 40)])
@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_half_of_the_target_hidden(side, color):
    rng, found = np.random.default_rng(15), []
    for psi in random_poses_in_view(rng, BOX, RIG, 4):
        images = render(BOX, psi, RIG)
        for image in images:
            v, u = np.nonzero(np.ptp(image, axis=2) > 60)
            middle_u, middle_v = int(u.mean()), int(v.mean())
            if side in ("left", "right"):
                image[:, slice(middle_u) if side == "left" else slice(middle_u, None)] = color
            else:
                image[slice(middle_v) if side == "top" else slice(middle_v, None)] = color
        start = displaced(psi, rng)
        result = REFINER.refine(start, images)
        if result.converged:
            found.append(errors(result.pose, psi))
            assert nees(result, psi) < 30.0
        else:
            np.testing.assert_array_equal(result.pose, start)
    assert len(found) >= 2
    assert (root_mean_square(found) < [1.5, 0.5]).all()


# Other rigs


def test_odd_cameras_are_as_accurate_as_the_pair_and_a_third_camera_more():
    right, left = RIG.cameras
    barrel, fisheye = RIGS["plumb_bob"].cameras[1], RIGS["equidistant"].cameras[1]
    third = odd_camera("pincushion", name="third", p_CK=(-0.07, -0.14, 0.03))
    drawn = [right, left, barrel, dataclasses.replace(fisheye, name="fisheye"), third]
    # Poses that all of the cameras see
    poses = random_poses_in_view(np.random.default_rng(32), BOX, CameraRig(drawn), 16)
    rng = np.random.default_rng(31)
    images = [noisy(render(BOX, psi, CameraRig(drawn), supersampling=4), rng, 4) for psi in poses]
    starts = [displaced(psi, rng) for psi in poses]
    found, values = {}, {}
    for used in ((0, 1), (0, 2), (0, 3), (0, 2, 4), (2,)):
        rig = CameraRig(drawn[k] for k in used)
        refiner = BorderRefiner(Matcher(SearchModel(BOX), rig))
        results = [
            refiner.refine(start, [pictures[k] for k in used])
            for start, pictures in zip(starts, images, strict=True)
        ]
        assert [result.reason for result in results] == [""] * len(poses)
        both = list(zip(results, poses, strict=True))
        found[used] = root_mean_square([errors(result.pose, psi) for result, psi in both])
        values[used] = np.mean([nees(result, psi) for result, psi in both])
    pair, three, alone = found[0, 1], found[0, 2, 4], found[2,]
    assert (pair < [0.08, 0.015]).all()
    # Sixteen poses tell errors to within a fifth.
    assert (found[0, 2] < 1.2 * pair).all() and (found[0, 3] < 1.2 * pair).all()
    assert (three < 0.95 * pair).all() and (three < 0.95 * found[0, 2]).all()
    # One camera takes depth from the target's size in the image.
    assert (alone < [0.2, 0.03]).all()
    assert all(0.3 < value < NEES_OF_20 for value in values.values())


@pytest.mark.parametrize("rig", ["three", "equidistant"])
def test_refinement_does_not_depend_on_where_the_rig_s_frame_is(rig):
    rig = RIGS[rig]
    rng = np.random.default_rng(33)
    [psi] = random_poses_in_view(rng, BOX, rig, 1)
    images = noisy(render(BOX, psi, rig, supersampling=3), rng, 3)
    start = displaced(psi, rng)
    R_DC, p_DC = rotation((0.2, -0.3, 0.1)), np.array([0.3, -0.2, 0.5])
    moved = CameraRig(
        dataclasses.replace(c, R_CK=R_DC @ c.R_CK, p_CK=R_DC @ c.p_CK + p_DC) for c in rig.cameras
    )
    here = BorderRefiner(Matcher(SearchModel(BOX), rig)).refine(start, images)
    refiner = BorderRefiner(Matcher(SearchModel(BOX), moved))
    there = refiner.refine(transport_pose(start, R_DC, p_DC), images)
    assert here.converged and there.converged
    assert there.num_borders == here.num_borders and there.fitness == pytest.approx(here.fitness)
    np.testing.assert_allclose(there.pose, transport_pose(here.pose, R_DC, p_DC), atol=1e-7)
    turned = R_DC @ here.covariance[:3, :3] @ R_DC.T
    np.testing.assert_allclose(there.covariance[:3, :3], turned, rtol=1e-3, atol=1e-12)


def test_bgr_images_and_gains():
    start = displaced(TRUTH, np.random.default_rng(34))
    expected = REFINER.refine(start, IMAGES[ANTIALIASED])
    bgr = BorderRefiner(Matcher(SearchModel(BOX), RIG, channel_order="bgr"))
    swapped = [image[..., ::-1] for image in IMAGES[ANTIALIASED]]
    found = bgr.refine(start, swapped)
    assert found.converged and found.num_borders == expected.num_borders
    np.testing.assert_allclose(found.pose, expected.pose, rtol=0, atol=1e-9)
    assert REFINER.refine(start, swapped).num_borders < 0.8 * expected.num_borders
    # Reddish light
    dim = [
        np.rint((0.15 + 0.6 * (image / 255.0)) * [255.0, 90.0, 70.0]).astype(np.uint8)
        for image in IMAGES[ANTIALIASED]
    ]
    refiner = BorderRefiner(Matcher(SearchModel(BOX), RIG, MatchingParameters(min_saturation=0.5)))
    balanced = refiner.refine(start, dim, gains=(1.0, 255.0 / 90.0, 255.0 / 70.0))
    assert balanced.converged
    assert (errors(balanced.pose, TRUTH) < np.array([0.2, 0.05])).all()
    unbalanced = refiner.refine(start, dim)
    assert not unbalanced.converged or unbalanced.num_borders < 0.8 * balanced.num_borders


# Covariance


@pytest.mark.parametrize(
    ("sampling", "noise"), [(ALIASED, 0), (ALIASED, 3), (ANTIALIASED, 2), (ANTIALIASED, 4)]
)
def test_the_covariance_is_not_too_small(sampling, noise):
    values = []
    for seed in range(20):
        rng = np.random.default_rng([16, seed])
        psi = random_poses_in_view(rng, BOX, RIG, 1)[0]
        images = noisy(render(BOX, psi, RIG, supersampling=sampling), rng, noise)
        result = REFINER.refine(displaced(psi, rng), images)
        if result.converged:
            np.testing.assert_allclose(result.covariance, result.covariance.T, atol=1e-15)
            values.append(nees(result, psi))
    assert len(values) >= 19
    assert 0.3 < np.mean(values) < NEES_OF_20


# Calibration errors

UNBOUNDED = RefinementParameters(max_position_std=1.0, max_rotation_std_deg=90.0)


def with_errors(rig, *deviations):
    """A rig whose cameras may be off by so many pixels each."""
    return CameraRig(
        dataclasses.replace(camera, calibration_error=deviation)
        for camera, deviation in zip(rig.cameras, deviations, strict=True)
    )


@pytest.mark.parametrize("name", ["pair", "plumb_bob", "alone"])
def test_a_calibration_error_adds_as_much_as_poses_scatter(name):
    # All that a camera shows is off, its own way each time.
    rig, deviation, rng = RIGS[name], 0.15, np.random.default_rng(35)
    certain, erring = (
        BorderRefiner(Matcher(SearchModel(BOX), given), UNBOUNDED)
        for given in (rig, with_errors(rig, *[deviation] * len(rig.cameras)))
    )
    [psi] = random_poses_in_view(np.random.default_rng(39), BOX, rig, 1)
    values, plain_values, off_by, added = [], [], [], []
    for _ in range(40):
        off = CameraRig(
            dataclasses.replace(
                c, cx=c.cx + rng.normal(0.0, deviation), cy=c.cy + rng.normal(0.0, deviation)
            )
            for c in rig.cameras
        )
        images = render(BOX, psi, off, supersampling=4)
        plain, result = (refiner.refine(psi, images) for refiner in (certain, erring))
        if not (plain.converged and result.converged):
            continue
        np.testing.assert_allclose(result.pose, plain.pose, atol=1e-12)
        values.append(nees(result, psi))
        plain_values.append(nees(plain, psi))
        off_by.append(result.pose - psi)
        added.append(result.covariance - plain.covariance)
    assert len(values) >= 38
    # The images hardly have another error, and this one has two freedoms a camera.
    freedoms = 2 * len(rig.cameras)
    assert 0.7 * freedoms < np.mean(values) < 1.4 * freedoms
    assert np.mean(plain_values) > 20.0 * np.mean(values)
    # Forty errors tell their spread to within a ninth.
    stated = np.sqrt(np.diag(np.mean(added, axis=0)))
    np.testing.assert_allclose(root_mean_square(off_by), stated, rtol=0.3)


def test_every_camera_adds_its_own_square():
    rig = RIGS["three"]
    psi = random_poses_in_view(np.random.default_rng(37), BOX, rig, 1)[0]
    images = render(BOX, psi, rig, supersampling=3)

    def covariance(*deviations):
        erring = Matcher(SearchModel(BOX), with_errors(rig, *deviations))
        result = BorderRefiner(erring, UNBOUNDED).refine(psi, images)
        assert result.converged
        return result.covariance

    none = covariance(0.0, 0.0, 0.0)
    plain = BorderRefiner(Matcher(SearchModel(BOX), rig)).refine(psi, images)
    np.testing.assert_array_equal(none, plain.covariance)
    alone = [covariance(*row) - none for row in 0.2 * np.eye(3)]
    for added in alone:
        # Two directions: those of a shift along u and along v.
        sizes = np.linalg.eigvalsh(added)
        assert sizes[-2] > 0.0 and np.abs(sizes[:-2]).max() < 1e-9 * sizes[-1]
    both = covariance(0.2, 0.0, 0.6) - none
    np.testing.assert_allclose(both, alone[0] + 9.0 * alone[2], rtol=1e-6, atol=1e-15)


# When it fails


def assert_refused(result, given, reason):
    assert not result.converged
    assert reason in result.reason
    np.testing.assert_array_equal(result.pose, given)
    assert np.isnan(result.covariance).all()


def test_nothing_to_see():
    grey = np.full((480, 640, 3), 128, dtype=np.uint8)
    assert_refused(REFINER.refine(TRUTH, [grey, grey]), TRUTH, "too few borders")


def test_a_pose_far_off():
    start = TRUTH + [0.06, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert not REFINER.refine(start, IMAGES[ALIASED]).converged


@pytest.mark.parametrize("z", [-1.0, 0.02])
def test_a_pose_behind_or_around_the_camera(z):
    start = pose((0.0, 0.0, z))
    assert_refused(REFINER.refine(start, IMAGES[ALIASED]), start, "too few")


def test_a_solid_partly_out_of_the_image():
    psi = pose((0.20, 0.15, 0.78), TRUTH[3:])
    start = displaced(psi, np.random.default_rng(17))
    result = REFINER.refine(start, render(BOX, psi, RIG))
    if result.converged:
        assert errors(result.pose, psi)[0] < errors(start, psi)[0]


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"max_position_std": 1e-7}, "too uncertain"),
        ({"max_rotation_std_deg": 1e-6}, "too uncertain"),
        ({"max_shift": 1e-4}, "too far"),
        ({"max_turn_deg": 0.1}, "too far"),
        ({"min_borders": 5000}, "too few"),
        ({"min_trusted": 1.0}, "contradict"),
    ],
)
def test_every_rejection_has_its_reason(parameters, reason):
    start = displaced(TRUTH, np.random.default_rng(18))
    refiner = BorderRefiner(MATCHER, RefinementParameters(**parameters))
    assert_refused(refiner.refine(start, IMAGES[ALIASED]), start, reason)


def test_a_limit_may_be_as_great_as_a_number_can_be():
    greatest = RefinementParameters(max_position_std=1e308, max_rotation_std_deg=1e308)
    start = displaced(TRUTH, np.random.default_rng(18))
    assert BorderRefiner(MATCHER, greatest).refine(start, IMAGES[ALIASED]).converged


def test_a_less_fit_pose_is_refused():
    # Where points next to borders count, pixels that are rounded favor poses beside the true one.
    matcher = Matcher(SearchModel(BOX), RIG, MatchingParameters(min_border_distance=0.0))
    rng, images = np.random.default_rng(19), IMAGES[ALIASED]
    starts = np.array([displaced(TRUTH, rng, rng.uniform(0.0, 0.001), 0.1) for _ in range(300)])
    start = starts[matcher.fitness(starts, images).argmax()]
    tolerant = BorderRefiner(matcher).refine(start, images)
    assert tolerant.converged
    before, after = matcher.fitness([start, tolerant.pose], images)
    assert after == tolerant.fitness < before
    strict = BorderRefiner(matcher, RefinementParameters(fitness_tolerance=0.0))
    assert_refused(strict.refine(start, images), start, "less fit")


def test_refinement_makes_no_start_worse():
    rng = np.random.default_rng(20)
    for psi in random_poses_in_view(rng, BOX, RIG, 30):
        images = noisy(render(BOX, psi, RIG), rng, 3)
        start = displaced(psi, rng, rng.uniform(0.002, 0.03), rng.uniform(0.5, 6.0))
        result = REFINER.refine(start, images)
        # The distance of the corners counts both, position and orientation.
        before, after = (_corner_error(p, psi) for p in (start, result.pose))
        assert after <= before


def _corner_error(psi, truth):
    moved = [BOX.vertices @ rotation(p[3:]).T + p[:3] for p in (psi, truth)]
    return np.linalg.norm(moved[0] - moved[1], axis=1).max()


def test_wrong_images_are_named():
    for image in (np.zeros((48, 64, 3), np.uint8), np.zeros((480, 640, 3))):
        with pytest.raises(ValueError, match="uint8 and shape"):
            REFINER.refine(TRUTH, [image, image])


@pytest.mark.parametrize(
    "wrong",
    [
        {"window": 0}, {"fine_window": 9}, {"coarse_spacing": 0}, {"blend": 0},
        {"end_margin": -1.0}, {"min_cosine": 1.5}, {"min_contrast": 0.0}, {"max_mismatch": 2.0},
        {"min_borders": 3}, {"border_error": 0.0}, {"edge_error": -1.0}, {"min_trusted": 1.1},
        {"max_position_std": -1.0}, {"max_rotation_std_deg": math.nan}, {"max_shift": -1.0},
        {"max_turn_deg": 200.0}, {"fitness_tolerance": -0.1},
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RefinementParameters(**wrong)


# In the tracker


class Fixed:
    """Says that some pose is the refined one, whatever the images."""

    def __init__(self, psi, fitness=0.5):
        self.result = Refinement(np.asarray(psi), Outcome.CONVERGED, np.eye(6), fitness)

    def refine_scene(self, pose, scene):
        return self.result


def tracker(**parameters):
    return OneStepGaTracker(**{"matcher": MATCHER, "start": NearStart(TRUTH)} | parameters)


def test_a_refined_pose_is_recognized_and_takes_the_last_place_in_the_population():
    odd = TRUTH + 1.23456789e-5  # no genes give that
    plain, refined = tracker(), tracker(refiner=Fixed(odd))
    a, b = (t.start_population(IMAGES[ALIASED]) for t in (plain, refined))
    np.testing.assert_array_equal(b.best, odd)
    np.testing.assert_array_equal(b.poses[1:], a.poses[:-1])
    np.testing.assert_array_equal(b.fitness, np.concatenate([[0.5], a.fitness[:-1]]))
    np.testing.assert_array_equal(b.covariance, np.eye(6))
    assert a.covariance is None


def test_a_refined_pose_meets_the_next_frame_just_as_it_is():
    odd = TRUTH + 1.23456789e-5
    last = tracker(refiner=Fixed(odd)).start_population(IMAGES[ALIASED])
    following = tracker().track(last, IMAGES[ALIASED], frame=1)
    assert (following.poses == odd).all(axis=1).any()
    # Without its covariance a pose is one like any other.
    rounded = tracker().track(Generation(last.poses, last.fitness), IMAGES[ALIASED], frame=1)
    assert not (rounded.poses == odd).all(axis=1).any()


def test_a_failed_refinement_changes_nothing():
    plain, off = tracker(), tracker(refiner=NoRefinement())
    hopeless = tracker(refiner=BorderRefiner(MATCHER, RefinementParameters(min_borders=10**6)))
    results = []
    for algorithm in (plain, off, hopeless):
        generation = algorithm.start_population(IMAGES[ALIASED])
        for frame in range(1, 6):
            generation = algorithm.track(generation, IMAGES[ALIASED], frame=frame)
        results.append((generation.poses.tobytes(), generation.fitness.tobytes()))
    assert len(set(results)) == 1


@pytest.mark.parametrize("feedforward", [True, False])
def test_tracking_a_moving_target(feedforward):
    path = [pose((0.002 * k, 0.15, 0.78), (0.05, 0.005 * k, 0.0)) for k in range(12)]
    found = {}
    for name, refiner in (("none", NoRefinement()), ("borders", REFINER)):
        algorithm = tracker(refiner=refiner, start=NearStart(path[0]), seed=3)
        generation = algorithm.start_population(render(BOX, path[0], RIG))
        found[name] = []
        for k in range(1, len(path)):
            if feedforward:
                (R0, p0), (R1, p1) = (transform_from_pose(p) for p in path[k - 1 : k + 1])
                R = R1 @ R0.T
                moved = transport_pose(generation.poses, R, p1 - R @ p0)
                generation = Generation(moved, generation.fitness, generation.covariance)
            generation = algorithm.track(generation, render(BOX, path[k], RIG), frame=k)
            found[name].append(errors(generation.best, path[k]))
    settled = {name: root_mean_square(values[4:]) for name, values in found.items()}
    assert (settled["borders"] < [0.3, 0.1]).all()
    assert (settled["borders"] < 0.5 * settled["none"]).all()


def test_the_quaternion_s_sign_does_not_matter():
    # Close to a half turn the vector part may jump to its opposite; the pose is the same.
    eps = quaternion_vector(rotation((0.0, 0.0, 0.999)))
    psi = pose((0.0, 0.15, 0.8), eps)
    result = REFINER.refine(displaced(psi, np.random.default_rng(21)), render(BOX, psi, RIG))
    assert result.converged
    assert errors(result.pose, psi)[0] < 1.0
