"""Equations (19)-(22): the fitness of poses, against closed forms and a brute-force oracle."""

import colorsys
import dataclasses
import math

import numpy as np
import oracle
import pytest
from synthetic import (
    GREY,
    PAPER_POSITION,
    arc_poses,
    hexagonal_prism,
    odd_camera,
    odd_rig,
    paper_box,
    pose,
    quaternion_vector,
    random_poses,
    random_poses_in_view,
    render,
    rotation,
    small_rig,
    tetrahedron,
)

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    CameraRig,
    ColorModel,
    Distortion,
    Matcher,
    MatchingParameters,
    SamplingParameters,
    SearchModel,
    SolidModel,
)

RIG = CameraRig.stereo()
FOCAL_LENGTH = RIG.cameras[0].fx
SOLIDS = {"box": paper_box(), "prism": hexagonal_prism(), "tetrahedron": tetrahedron()}
MATCHERS = {name: Matcher(SearchModel(solid), RIG) for name, solid in SOLIDS.items()}

matchers = pytest.mark.parametrize("matcher", MATCHERS.values(), ids=MATCHERS)


def solid_of(matcher):
    return matcher.search_model.solid


def fitness_at(matcher, psi, **how):
    """Fitness of the true pose on its own images."""
    images = render(solid_of(matcher), psi, matcher.rig, **how)
    return matcher.fitness([psi], images)[0]


def color_of(hue, saturation=1.0, value=1.0):
    """8-bit color of a hue [rad]."""
    rgb = colorsys.hsv_to_rgb(hue / (2 * math.pi), saturation, value)
    return np.rint(255 * np.array(rgb)).astype(np.uint8)


def painted(color, rig=RIG):
    """Images of one color."""
    return tuple(np.full((c.height, c.width, 3), color, dtype=np.uint8) for c in rig.cameras)


# The true pose


@pytest.mark.parametrize("psi", arc_poses(9))
def test_true_pose_fits_all_along_the_paper_s_arc(psi):
    assert fitness_at(MATCHERS["box"], psi) >= 0.98


@matchers
def test_true_pose_fits_anywhere_in_the_search_range(matcher):
    rng = np.random.default_rng(1)
    poses = random_poses_in_view(rng, solid_of(matcher), RIG, 25)
    assert min(fitness_at(matcher, psi) for psi in poses) >= 0.98


@matchers
def test_true_pose_fits_anti_aliased_images(matcher):
    rng = np.random.default_rng(2)
    poses = [*random_poses_in_view(rng, solid_of(matcher), RIG, 4), *arc_poses(2)]
    assert min(fitness_at(matcher, psi, supersampling=3) for psi in poses) >= 0.98


@pytest.mark.parametrize("brightness", [0.25, 0.7])
def test_true_pose_fits_faces_in_the_shade(brightness):
    assert fitness_at(MATCHERS["box"], pose(PAPER_POSITION), brightness=brightness) >= 0.98


@pytest.mark.parametrize("background", [0, 64, 255])
def test_no_grey_background_counts_as_a_color(background):
    assert fitness_at(MATCHERS["box"], pose(PAPER_POSITION), background=background) >= 0.98


# Wrong poses


@pytest.mark.parametrize(
    ("deviation", "most"),
    [
        ([0.014, 0, 0, 0, 0, 0], 0.9),
        ([0, 0.014, 0, 0, 0, 0], 0.9),
        ([0, 0, 0.030, 0, 0, 0], 0.95),
        ([0, 0, 0, 0.15, 0, 0], 0.9),
        ([0, 0, 0, 0, 0.15, 0], 0.9),
        ([0, 0, 0, 0, 0, 0.15], 0.9),
    ],
    ids=["x", "y", "z", "eps1", "eps2", "eps3"],
)
def test_a_wrong_coordinate_lowers_the_fitness(deviation, most):
    matcher = MATCHERS["box"]
    rng = np.random.default_rng(3)
    for psi in [*arc_poses(3), *random_poses_in_view(rng, solid_of(matcher), RIG, 5)]:
        images = render(solid_of(matcher), psi, RIG)
        true, above, below = matcher.fitness(psi + np.outer([0, 1, -1], deviation), images)
        assert max(above, below) < most < true


@matchers
def test_random_poses_score_less_than_the_true_one(matcher):
    rng = np.random.default_rng(4)
    for psi in random_poses_in_view(rng, solid_of(matcher), RIG, 2):
        images = render(solid_of(matcher), psi, RIG)
        others = random_poses(rng, 1000)
        far = np.linalg.norm(others[:, :3] - psi[:3], axis=1) > 0.030
        assert matcher.fitness(others[far], images).max() < 0.9


def test_a_plain_wall_of_the_face_s_color_is_no_match():
    # The inside points all match, and so does the strip.
    matcher = front_face_matcher((BLUE,) * 6, (0.006, 0.008))
    assert matcher.fitness([pose((0, 0, 0.8))], painted(color_of(BLUE))) == 0.0


# Closed forms: a box seen head-on, so that both cameras see its front face alone

FRONT = 40  # inside points of the 100 mm x 150 mm face, on cells of 20 mm
OUTLINE = 2 * (5 + 8)  # points of one row of the strip around it


def front_face_matcher(hues, strip_offsets=(0.006,), **parameters):
    """A box with a hue for each face +x, -x, +y, -y, +z, -z, and two cameras 10 mm apart."""
    box = paper_box()
    sampling = SamplingParameters(spacing=0.020, margin=None, strip_offsets=strip_offsets)
    return Matcher(
        SearchModel(SolidModel(box.vertices, box.faces, hues), sampling),
        CameraRig.stereo(baseline=0.010),
        MatchingParameters(**parameters),
    )


HEAD_ON = pose((-0.005, 0.0, 0.8))  # in the middle between the cameras
SIX_HUES = np.radians([0, 60, 120, 180, 240, 300])  # the face in front, -z, is the last


def front_image(matcher, inside, outside):
    """The front face's pixels in one color, all others in another."""
    pair = painted(outside, matcher.rig)
    corners = HEAD_ON[:3] + np.array([[-0.05, -0.075, -0.1], [0.05, 0.075, -0.1]])
    images = []
    for image, ((u0, v0), (u1, v1)) in zip(pair, matcher.rig.project(corners), strict=True):
        image = image.copy()
        image[math.ceil(v0) : math.floor(v1) + 1, math.ceil(u0) : math.floor(u1) + 1] = inside
        images.append(image)
    return images


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_strip_point_is_subtracted_once_though_faces_share_its_hue(rows):
    offsets = np.linspace(0.002, 0.003, rows)
    matcher = front_face_matcher([GREEN] * 6, tuple(offsets))
    [fitness] = matcher.fitness([HEAD_ON], painted(color_of(GREEN)))
    assert fitness == pytest.approx(max(0.0, (FRONT - rows * OUTLINE) / FRONT))


@pytest.mark.parametrize("hidden", range(5))
def test_a_strip_point_counts_with_a_hidden_face_s_hue(hidden):
    matcher = front_face_matcher(SIX_HUES)
    images = front_image(matcher, color_of(SIX_HUES[5]), color_of(SIX_HUES[hidden]))
    assert matcher.fitness([HEAD_ON], images)[0] == pytest.approx((FRONT - OUTLINE) / FRONT)


def test_a_strip_point_on_a_hue_that_the_model_has_not_is_free():
    matcher = front_face_matcher(SIX_HUES)
    images = front_image(matcher, color_of(SIX_HUES[5]), color_of(math.radians(270)))
    assert matcher.fitness([HEAD_ON], images)[0] == 1.0


def test_an_inside_point_counts_with_its_own_face_s_hue_only():
    matcher = front_face_matcher(SIX_HUES)
    for hue, expected in zip(SIX_HUES, [0, 0, 0, 0, 0, 1], strict=True):
        images = front_image(matcher, color_of(hue), GREY)
        assert matcher.fitness([HEAD_ON], images)[0] == expected


def test_fitness_is_the_share_of_the_matching_inside_points():
    matcher = front_face_matcher(SIX_HUES)
    images = front_image(matcher, color_of(SIX_HUES[5]), GREY)
    for image in images:
        image[: image.shape[0] // 2] = GREY  # the upper half: 4 of 8 rows of points
    assert matcher.fitness([HEAD_ON], images)[0] == 0.5


def test_fitness_is_the_mean_of_both_cameras_and_none_is_below_zero():
    matcher = front_face_matcher(SIX_HUES, (0.006, 0.008))
    right, left = front_image(matcher, color_of(SIX_HUES[5]), GREY)
    wall, _ = front_image(matcher, GREY, color_of(SIX_HUES[5]))  # the strip alone matches
    assert matcher.fitness([HEAD_ON], [right, left])[0] == 1.0
    assert matcher.fitness([HEAD_ON], [right, wall])[0] == 0.5
    assert matcher.fitness([HEAD_ON], [wall, left])[0] == 0.5
    assert matcher.fitness([HEAD_ON], [wall, wall])[0] == 0.0


def test_the_cameras_are_not_mixed_up():
    # Shifted by the baseline: the right image shows the box where the left camera sees it.
    matcher = MATCHERS["box"]
    psi = pose(PAPER_POSITION)
    right, left = render(solid_of(matcher), psi, RIG)
    assert matcher.fitness([psi], [right, left])[0] == 1.0
    assert matcher.fitness([psi], [left, right])[0] < 0.1


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        (color_of(math.radians(300 - 19)), 1),
        (color_of(math.radians(300 + 19)), 1),
        (color_of(math.radians(300 - 21)), 0),
        (color_of(math.radians(300 + 21)), 0),
        (color_of(math.radians(300), saturation=0.52), 1),
        (color_of(math.radians(300), saturation=0.48), 0),
        (color_of(math.radians(300), value=0.22), 1),
        (color_of(math.radians(300), value=0.18), 0),
    ],
)
def test_a_pixel_has_a_hue_within_the_tolerance_and_above_both_gates(color, expected):
    matcher = front_face_matcher(
        SIX_HUES, hue_tolerance_deg=20.0, min_saturation=0.5, min_value=0.2
    )
    images = front_image(matcher, color, GREY)
    assert matcher.fitness([HEAD_ON], images)[0] == expected


@pytest.mark.parametrize(("model", "image"), [(1, 359), (359, 1), (355, 10), (10, 355)])
def test_hues_are_compared_around_the_color_circle(model, image):
    matcher = front_face_matcher(np.radians([120, 120, 120, 120, 120, model]))
    images = front_image(matcher, color_of(math.radians(image)), GREY)
    assert matcher.fitness([HEAD_ON], images)[0] == 1.0


@pytest.mark.parametrize("level", [0, 20, 128, 255])
def test_grey_images_score_zero(level):
    for matcher in MATCHERS.values():
        poses = random_poses(np.random.default_rng(5), 200)
        np.testing.assert_array_equal(matcher.fitness(poses, painted(level)), 0.0)


def test_grey_has_no_hue_even_without_gates():
    matcher = front_face_matcher([RED] * 6, min_saturation=0.0, min_value=0.0)
    np.testing.assert_array_equal(matcher.fitness([HEAD_ON], painted(GREY)), 0.0)


def test_dark_images_score_zero():
    psi = pose(PAPER_POSITION)
    assert fitness_at(MATCHERS["box"], psi, brightness=0.15) == 0.0


# The faces' borders


def pixels(length):
    """Pixels of a length [m] on the face in front of the box seen head-on."""
    return FOCAL_LENGTH * length / (HEAD_ON[2] - 0.100)


def ringed_image(matcher, core, ring, outside=GREY, half=(0.035, 0.060), reach=0.0):
    """The front face's middle, its remaining ring, widened by a reach [m], and all else."""
    pair = [image.copy() for image in painted(outside, matcher.rig)]
    for half_size, color in (((0.05 + reach, 0.075 + reach), ring), (half, core)):
        corners = HEAD_ON[:3] + np.array([[*np.negative(half_size), -0.1], [*half_size, -0.1]])
        for image, ends in zip(pair, matcher.rig.project(corners), strict=True):
            (u0, v0), (u1, v1) = np.rint(ends).astype(int)
            image[v0:v1, u0:u1] = color
    return pair


@pytest.mark.parametrize(
    ("least", "in_core"),
    # The outermost points lie half a cell, some 10 mm, inside; the core begins at 15 mm.
    [(0.0, 18), (0.009, 18), (0.011, 18), (0.013, 18), (0.017, 40), (0.034, 40), (0.049, 40)],
)
def test_points_near_a_face_s_border_are_moved_inward_and_count(least, in_core):
    matcher = front_face_matcher(SIX_HUES, min_border_distance=pixels(least))
    color = color_of(SIX_HUES[5])
    core, ring = (ringed_image(matcher, *colors) for colors in ((color, GREY), (GREY, color)))
    assert matcher.fitness([HEAD_ON], core)[0] == pytest.approx(in_core / FRONT)
    assert matcher.fitness([HEAD_ON], ring)[0] == pytest.approx(1 - in_core / FRONT)


def test_points_are_moved_no_farther_than_to_the_least_distance():
    # To 16 mm off the border, which is within a band from 15 mm to 18 mm, and the others stay.
    matcher = front_face_matcher(SIX_HUES, min_border_distance=pixels(0.016))
    color = color_of(SIX_HUES[5])
    [fitness] = matcher.fitness([HEAD_ON], ringed_image(matcher, GREY, color, half=(0.032, 0.057)))
    assert fitness == pytest.approx(22 / FRONT)


@pytest.mark.parametrize(("least", "expected"), [(0.049, 1.0), (0.051, 0.0)])
def test_no_point_of_a_face_counts_that_is_narrower_than_twice_the_distance(least, expected):
    # The face is 100 mm wide.
    matcher = front_face_matcher(SIX_HUES, min_border_distance=pixels(least))
    images = front_image(matcher, color_of(SIX_HUES[5]), GREY)
    assert matcher.fitness([HEAD_ON], images)[0] == expected


@pytest.mark.parametrize("least", [1.0, 3.0])
def test_an_obliquely_seen_face_keeps_its_count_until_it_is_too_narrow(least):
    # All pixels have the side face's hue, and the strip lies outside of the images: the fitness is
    # that face's share of the counted points, 80 of 120.
    matcher = front_face_matcher(SIX_HUES, (5.0,), min_border_distance=least)
    images = painted(color_of(SIX_HUES[0]), matcher.rig)
    wide, narrow = [], []
    # The edge of sight is where the side's plane passes through the cameras.
    corners = solid_of(matcher).vertices[list(solid_of(matcher).faces[0])]
    for turn in math.asin(0.05 / 0.8) + np.geomspace(0.002, 0.4, 80):
        psi = pose(HEAD_ON[:3], (0, math.sin(0.5 * turn), 0))
        pixels_of_corners = matcher.rig.project(corners @ rotation(psi[3:]).T + psi[:3])
        widths = [np.ptp(uv[:, 0]) for uv in pixels_of_corners]
        [fitness] = matcher.fitness([psi], images)
        if min(widths) > 2.2 * least:
            wide.append(fitness)
        elif max(widths) < 1.8 * least:
            narrow.append(fitness)
    assert len(wide) > 10 and len(narrow) > 5
    np.testing.assert_allclose(wide, 80 / 120)
    np.testing.assert_array_equal(narrow, 0.0)


@pytest.mark.parametrize(
    ("least", "reach", "matches"),
    # The strip's offset is 3 mm, or the least distance where that is more.
    [(0.0, 0.001, 0), (0.0, 0.005, 1), (0.001, 0.005, 1), (0.009, 0.007, 0), (0.009, 0.011, 1)],
)
def test_the_strip_is_moved_outward_to_the_least_distance(least, reach, matches):
    matcher = front_face_matcher(SIX_HUES, (0.003,), min_border_distance=pixels(least))
    color = color_of(SIX_HUES[5])
    images = ringed_image(matcher, color, color, reach=reach)
    [fitness] = matcher.fitness([HEAD_ON], images)
    assert fitness == pytest.approx((FRONT - matches * OUTLINE) / FRONT)


def test_no_points_left_score_zero():
    matcher = front_face_matcher(SIX_HUES, min_border_distance=500.0)
    images = front_image(matcher, color_of(SIX_HUES[5]), GREY)
    assert matcher.fitness([HEAD_ON], images)[0] == 0.0


@matchers
def test_counted_points_are_off_their_face_s_border_in_the_image(matcher):
    # The distance is reckoned at the middle of each side, so it holds up to the change of depth
    # along the side. Rounding to pixels moves a point by 0.71 px at most: what is counted at the
    # true pose shows the face.
    rng = np.random.default_rng(6)
    for psi in random_poses_in_view(rng, solid_of(matcher), RIG, 4):
        images = painted(GREY)
        for score in oracle.scores(matcher, psi, images):
            distances = oracle.border_distances(score, FOCAL_LENGTH)
            assert min(distances) > 0.85 * matcher.parameters.min_border_distance


def test_a_face_seen_nearly_edge_on_does_not_pay_for_turning_it_out_of_sight():
    # Between two and one visible faces: the plane of the top passes through the cameras.
    _, y, z = PAPER_POSITION
    edge_on = math.atan2(y, z) - math.asin(0.075 / math.hypot(y, z))
    true, turned_away = (
        pose(PAPER_POSITION, (-math.sin(0.5 * (edge_on + turn)), 0, 0)) for turn in (-0.001, 0.001)
    )
    model = SearchModel(paper_box())
    images = render(paper_box(), true, RIG)
    every_point, clear_points = (
        Matcher(model, RIG, MatchingParameters(min_border_distance=least)) for least in (0.0, 1.0)
    )
    assert oracle.scores(every_point, true, images)[0].visible.count(True) == 2
    assert oracle.scores(every_point, turned_away, images)[0].visible.count(True) == 1
    # If every point counted, those of the top would lie in a row of pixels that show its neighbor.
    at_truth, away = every_point.fitness([true, turned_away], images)
    assert at_truth < away - 0.3
    at_truth, away = clear_points.fitness([true, turned_away], images)
    assert at_truth >= 0.98
    assert at_truth >= away


def test_min_cosine_hides_faces_seen_at_a_small_angle():
    # The box left of the camera's axis: its right face is seen at a cosine of 0.3.
    psi = pose((-0.05 - 0.3, 0.0, math.sqrt(1 - 0.3**2)))
    rig = CameraRig.stereo(baseline=0.001)
    right, left = render(paper_box(), psi, rig)
    for image in (right, left):
        image[(image == (255, 0, 0)).all(axis=-1)] = GREY  # what shows of the red face
    model = SearchModel(paper_box())
    seen, unseen = (
        Matcher(model, rig, MatchingParameters(min_cosine=c)).fitness([psi], [right, left])[0]
        for c in (0.25, 0.35)
    )
    assert seen < 0.8
    assert unseen == 1.0


# Against the oracle


def speckled(images, rng):
    """Images with a fifth of their pixels replaced by random colors."""
    result = []
    for image in images:
        noise = rng.integers(0, 256, size=image.shape, dtype=np.uint8)
        noise[..., rng.integers(0, 3)] //= 8
        where = rng.random(image.shape[:2]) < 0.2
        result.append(np.where(where[..., None], noise, image))
    return result


def assert_equals_oracle(matcher, poses, images):
    expected = [oracle.fitness(matcher, psi, images) for psi in poses]
    # Neither all zero nor all alike: the comparison means something.
    assert len(set(expected)) > len(poses) / 2
    np.testing.assert_allclose(matcher.fitness(poses, images), expected, rtol=0, atol=1e-12)


# Not the default's 20 deg: some 8-bit colors have exactly that hue, on either side by rounding.
TOLERANCE = {"hue_tolerance_deg": 20.3}
COARSE = SamplingParameters(spacing=0.040, margin=0.003, strip_offsets=(0.004,))


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"hue_tolerance_deg": 33.3, "min_saturation": 0.21, "min_value": 0.37},
        {"min_cosine": 0.05, "min_border_distance": 3.0},
        {"min_border_distance": 0.0},
    ],
    ids=["default", "hue", "visibility", "no border"],
)
@pytest.mark.parametrize("name", SOLIDS)
def test_fitness_equals_the_oracle_s(name, parameters):
    parameters = MatchingParameters(**TOLERANCE | parameters)
    matcher = Matcher(SearchModel(SOLIDS[name], COARSE), RIG, parameters)
    rng = np.random.default_rng(7)
    [psi] = random_poses_in_view(rng, SOLIDS[name], RIG, 1)
    images = speckled(render(SOLIDS[name], psi, RIG), rng)
    near = psi + rng.normal(size=(10, 6)) * [0.01, 0.01, 0.03, 0.04, 0.04, 0.04]
    assert_equals_oracle(matcher, np.vstack([psi, near, random_poses(rng, 2)]), images)


def test_fitness_equals_the_oracle_s_with_the_default_sampling():
    matcher = Matcher(SearchModel(paper_box()), RIG, MatchingParameters(**TOLERANCE))
    rng = np.random.default_rng(8)
    psi = arc_poses(3)[2]
    images = speckled(render(solid_of(matcher), psi, RIG, supersampling=2), rng)
    near = psi + rng.normal(size=(5, 6)) * [0.01, 0.01, 0.03, 0.04, 0.04, 0.04]
    assert_equals_oracle(matcher, np.vstack([psi, near]), images)


def test_fitness_equals_the_oracle_s_partly_outside_of_the_images():
    solid = hexagonal_prism()
    rig = small_rig()
    matcher = Matcher(SearchModel(solid, COARSE), rig, MatchingParameters(**TOLERANCE))
    psi = pose((0.20, 0.18, 0.60), (0.1, -0.2, 0.3))
    rng = np.random.default_rng(9)
    images = speckled(render(solid, psi, rig), rng)
    corners = np.concatenate(rig.project(solid.vertices + psi[:3]))
    assert corners[:, 0].max() > 160 and corners[:, 1].max() > 120
    near = psi + rng.normal(size=(12, 6)) * [0.01, 0.01, 0.03, 0.04, 0.04, 0.04]
    assert_equals_oracle(matcher, np.vstack([psi, near]), images)


def test_fitness_equals_the_oracle_s_around_the_camera():
    # Points behind the camera have no pixel; from inside of the solid no face is visible.
    rig = small_rig()
    matcher = Matcher(SearchModel(paper_box(), COARSE), rig)
    rng = np.random.default_rng(10)
    poses = rng.uniform([-0.2, -0.1, -0.1, *[-0.5] * 3], [0.1, 0.1, 0.3, *[0.5] * 3], (25, 6))
    images = painted(color_of(BLUE), rig)
    expected = [oracle.fitness(matcher, psi, images) for psi in poses]
    assert np.count_nonzero(expected) >= 4
    np.testing.assert_allclose(matcher.fitness(poses, images), expected, rtol=0, atol=1e-12)
    assert matcher.fitness([pose((0.0, 0.0, 0.0))], images)[0] < 1.0


def test_visible_points_behind_the_camera_count_as_inside_points_without_a_match():
    # A plank along the line of sight, below the cameras, its end behind them.
    plank = SolidModel.box((0.6, 0.1, 1.6), (RED, GREEN, BLUE))
    rig = small_rig()
    matcher = Matcher(SearchModel(plank, COARSE), rig, MatchingParameters(**TOLERANCE))
    psi = pose((-0.075, 0.25, 0.6))
    images = painted(color_of(GREEN), rig)
    for score in oracle.scores(matcher, psi, images):
        depths = np.array([q[2] for q, _ in score.points])
        assert (depths < 0).sum() > 20 and (depths > 0).sum() > 200
    rng = np.random.default_rng(13)
    assert_equals_oracle(matcher, psi + rng.normal(size=(8, 6)) * 0.03, images)


# Other rigs

RIGS = {
    "plumb_bob": odd_rig("barrel"),
    "equidistant": odd_rig("equidistant"),
    "three": odd_rig("rational", "pincushion"),
    "alone": CameraRig((odd_camera("barrel"),)),
    "alone, equidistant": CameraRig((odd_camera("equidistant"),)),
    "pinhole alone": CameraRig(RIG.cameras[:1]),
}
rigs = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


@rigs
@pytest.mark.parametrize("name", SOLIDS)
def test_fitness_equals_the_oracle_s_with_odd_cameras(name, rig):
    parameters = MatchingParameters(**TOLERANCE)
    matcher = Matcher(SearchModel(SOLIDS[name], COARSE), rig, parameters)
    rng = np.random.default_rng(14)
    [psi] = random_poses_in_view(rng, SOLIDS[name], rig, 1)
    images = speckled(render(SOLIDS[name], psi, rig), rng)
    near = psi + rng.normal(size=(8, 6)) * [0.01, 0.01, 0.03, 0.04, 0.04, 0.04]
    assert_equals_oracle(matcher, np.vstack([psi, near, random_poses(rng, 2)]), images)


@pytest.mark.parametrize("error", [0.7, 4.0])
def test_fitness_equals_the_oracle_s_with_cameras_that_may_be_off(error):
    # Points keep so much farther off the borders, in that camera alone.
    right, odd = RIGS["plumb_bob"].cameras
    rig = CameraRig((right, dataclasses.replace(odd, calibration_error=error)))
    matcher = Matcher(SearchModel(paper_box(), COARSE), rig, MatchingParameters(**TOLERANCE))
    rng = np.random.default_rng(15)
    [psi] = random_poses_in_view(rng, paper_box(), rig, 1)
    images = speckled(render(paper_box(), psi, rig), rng)
    poses = psi + rng.normal(size=(10, 6)) * [0.01, 0.01, 0.03, 0.04, 0.04, 0.04]
    assert_equals_oracle(matcher, poses, images)
    certain = Matcher(SearchModel(paper_box(), COARSE), RIGS["plumb_bob"], matcher.parameters)
    assert (certain.fitness(poses, images) != matcher.fitness(poses, images)).any()


@pytest.mark.parametrize(
    "distortion",
    [
        Distortion("plumb_bob", (-0.35, 0.02, 0.0, 0.0)),
        Distortion("equidistant", (-0.3, -0.1, 0.0, 0.0)),
    ],
    ids=["plumb_bob", "equidistant"],
)
def test_fitness_equals_the_oracle_s_where_the_lens_would_fold_points_back(distortion):
    # A plank that reaches far aside, and an image of its color: what is folded back would match.
    wide = small_rig().cameras[0]
    wide = dataclasses.replace(wide, fx=60.0, fy=60.0, distortion=distortion)
    matcher = Matcher(
        SearchModel(SolidModel.box((1.6, 0.3, 0.1), [GREEN] * 3), COARSE),
        CameraRig((wide,)),
        MatchingParameters(**TOLERANCE),
    )
    images = painted(color_of(GREEN), matcher.rig)
    poses = pose((0.2, 0.0, 0.5)) + np.random.default_rng(16).normal(size=(8, 6)) * 0.05
    radii = []
    for psi in poses:
        [score] = oracle.scores(matcher, psi, images)
        radii += [math.hypot(*q[:2]) / q[2] for q, _ in score.points]
    beyond = np.mean(np.array(radii) > distortion.max_radius)
    assert 0.1 < beyond < 0.6
    assert_equals_oracle(matcher, poses, images)


@rigs
def test_the_true_pose_is_the_fittest_nearby(rig):
    matcher = Matcher(SearchModel(paper_box()), rig)
    rng = np.random.default_rng(17)
    deviations = np.diag([0.014, 0.014, 0.030, 0.15, 0.15, 0.15])
    for psi in random_poses_in_view(rng, paper_box(), rig, 3):
        images = render(paper_box(), psi, rig)
        [true] = matcher.fitness([psi], images)
        assert true >= 0.98
        assert matcher.fitness(psi + np.vstack([deviations, -deviations]), images).max() < true
        # The fitness has a plateau, which one camera sees wider.
        near = psi + rng.normal(size=(300, 6)) * [0.01, 0.01, 0.03, 0.05, 0.05, 0.05]
        assert matcher.fitness(near, images).max() <= true + (0.0 if true == 1.0 else 0.02)


def test_fitness_is_the_mean_over_the_cameras():
    rig = RIGS["three"]
    rng = np.random.default_rng(18)
    [psi] = random_poses_in_view(rng, paper_box(), rig, 1)
    images = speckled(render(paper_box(), psi, rig), rng)
    poses = psi + rng.normal(size=(20, 6)) * 0.005
    model = SearchModel(paper_box())
    alone = [
        Matcher(model, CameraRig((camera,))).fitness(poses, [image])
        for camera, image in zip(rig.cameras, images, strict=True)
    ]
    together = Matcher(model, rig).fitness(poses, images)
    assert (np.ptp(alone, axis=0) > 0.01).all()
    np.testing.assert_allclose(together, np.mean(alone, axis=0), rtol=1e-12)
    # The order of the cameras makes no difference, as long as it is that of their images.
    turned = Matcher(model, CameraRig(rig.cameras[::-1])).fitness(poses, images[::-1])
    np.testing.assert_allclose(turned, together, rtol=1e-12)
    named = dict(zip(rig.names[::-1], images[::-1], strict=True))
    np.testing.assert_array_equal(Matcher(model, rig).fitness(poses, named), together)


@pytest.mark.parametrize("name", ["three", "equidistant"])
def test_fitness_does_not_depend_on_where_the_rig_s_frame_is(name):
    rig = RIGS[name]
    rng = np.random.default_rng(19)
    [psi] = random_poses_in_view(rng, paper_box(), rig, 1)
    images = speckled(render(paper_box(), psi, rig), rng)
    poses = psi + rng.normal(size=(20, 6)) * 0.02
    R_DC, p_DC = rotation((0.2, -0.3, 0.1)), np.array([0.3, -0.2, 0.5])
    moved = CameraRig(
        dataclasses.replace(c, R_CK=R_DC @ c.R_CK, p_CK=R_DC @ c.p_CK + p_DC) for c in rig.cameras
    )
    there = [pose(R_DC @ p[:3] + p_DC, quaternion_vector(R_DC @ rotation(p[3:]))) for p in poses]
    model = SearchModel(paper_box(), COARSE)
    expected = Matcher(model, rig).fitness(poses, images)
    assert len(set(expected)) > 10
    np.testing.assert_allclose(Matcher(model, moved).fitness(there, images), expected, atol=1e-12)


# Colors


def test_images_may_be_bgr():
    rng = np.random.default_rng(20)
    [psi] = random_poses_in_view(rng, paper_box(), RIG, 1)
    images = speckled(render(paper_box(), psi, RIG), rng)
    poses = psi + rng.normal(size=(20, 6)) * 0.02
    model = SearchModel(paper_box())
    rgb, bgr = (Matcher(model, RIG, channel_order=order) for order in ("rgb", "bgr"))
    swapped = [image[..., ::-1] for image in images]
    np.testing.assert_array_equal(bgr.fitness(poses, swapped), rgb.fitness(poses, images))
    assert (bgr.fitness(poses, images) < rgb.fitness(poses, images) - 0.1).any()
    with pytest.raises(ValueError, match="channel_order must be one of rgb, bgr, not 'gbr'"):
        Matcher(model, RIG, channel_order="gbr")


def test_gains_balance_the_light():
    # Reddish light: without green's and blue's gains, no face but the red one has its color.
    psi = pose(PAPER_POSITION, (0.1, 0.2, 0.1))
    images = [
        np.rint((0.2 + 0.6 * (im / 255.0)) * [255.0, 90.0, 70.0]).astype(np.uint8)
        for im in render(paper_box(), psi, RIG, background=40)
    ]
    matcher = Matcher(SearchModel(paper_box()), RIG, MatchingParameters(min_saturation=0.5))
    [unbalanced] = matcher.fitness([psi], images)
    [balanced] = matcher.fitness([psi], images, gains=(1.0, 255.0 / 90.0, 255.0 / 70.0))
    assert unbalanced < 0.7
    assert balanced >= 0.98


def test_colors_are_those_of_the_materials_where_they_are_given():
    # The mesh says red, green, blue; the things that were made look otherwise.
    box = paper_box()
    looks = dict(zip(box.materials[::2], np.radians([20.0, 170.0, 290.0]), strict=True))
    shown = SolidModel(box.vertices, box.faces, [looks[name] for name in box.materials])
    psi = pose(PAPER_POSITION, (0.1, 0.2, 0.1))
    images = render(shown, psi, RIG)
    colors = ColorModel.of_hues(looks, tolerance=math.radians(10.0))
    model = SearchModel(box)
    assert Matcher(model, RIG, colors=colors).fitness([psi], images)[0] >= 0.98
    assert Matcher(model, RIG).fitness([psi], images)[0] < 0.5
    # The parameters' tolerance and gates count for nothing then.
    blind = MatchingParameters(hue_tolerance_deg=0.0, min_saturation=1.0, min_value=1.0)
    assert Matcher(model, RIG, blind, colors).fitness([psi], images)[0] >= 0.98
    lacking = ColorModel(colors=colors.colors[1:])
    with pytest.raises(ValueError, match=f"no color for the solid's material {box.materials[0]}"):
        Matcher(model, RIG, colors=lacking)


# Points outside of the images


def test_a_solid_out_of_sight_scores_zero():
    poses = [pose((5.0, 0.0, 0.8)), pose((0.0, -5.0, 0.8)), pose((0.0, 0.155, -0.8))]
    np.testing.assert_array_equal(MATCHERS["box"].fitness(poses, painted(color_of(RED))), 0.0)


def test_inside_points_outside_of_the_image_lower_the_fitness_of_a_true_pose():
    matcher = MATCHERS["box"]
    half_out = pose((RIG.cameras[0].cx / FOCAL_LENGTH * 0.8, 0.0, 0.8))
    assert 0.1 < fitness_at(matcher, half_out) < 0.6


# Arguments


def test_many_poses_score_as_each_alone():
    matcher = MATCHERS["box"]
    psi = pose(PAPER_POSITION)
    images = render(solid_of(matcher), psi, RIG)
    poses = psi + np.random.default_rng(11).normal(size=(30, 6)) * 0.02
    together = matcher.fitness(poses, images)
    assert together.shape == (30,)
    np.testing.assert_array_equal(together, [matcher.fitness(p, images)[0] for p in poses])


def test_no_poses_give_no_fitness():
    assert MATCHERS["box"].fitness(np.empty((0, 6)), painted(GREY)).shape == (0,)


def test_an_alpha_channel_changes_nothing():
    matcher = MATCHERS["prism"]
    rng = np.random.default_rng(12)
    [psi] = random_poses_in_view(rng, solid_of(matcher), RIG, 1)
    images = speckled(render(solid_of(matcher), psi, RIG), rng)
    rgba = [
        np.dstack([image, rng.integers(0, 256, image.shape[:2], dtype=np.uint8)])
        for image in images
    ]
    poses = psi + rng.normal(size=(20, 6)) * 0.02
    expected = matcher.fitness(poses, images)
    assert np.count_nonzero(expected) > 10
    np.testing.assert_array_equal(matcher.fitness(poses, rgba), expected)


def test_images_may_be_read_only_and_stay_as_they_are():
    psi = pose(PAPER_POSITION)
    images = render(paper_box(), psi, RIG)
    before = [image.copy() for image in images]
    for image in images:
        image.flags.writeable = False
    assert MATCHERS["box"].fitness([psi], images)[0] >= 0.98
    np.testing.assert_array_equal(images, before)


@pytest.mark.parametrize("shape", [(480, 640), (640, 480, 3), (480, 640, 2), (240, 320, 3), (480,)])
@pytest.mark.parametrize("which", [0, 1])
def test_images_of_another_size_are_rejected(shape, which):
    images = list(painted(GREY))
    images[which] = np.zeros(shape, dtype=np.uint8)
    with pytest.raises(ValueError, match="480, 640"):
        MATCHERS["box"].fitness([pose(PAPER_POSITION)], images)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hue_tolerance_deg", -1.0),
        ("hue_tolerance_deg", 181.0),
        ("min_saturation", -0.1),
        ("min_saturation", 1.1),
        ("min_value", -0.1),
        ("min_value", 1.1),
        ("min_cosine", -0.1),
        ("min_cosine", 1.1),
        ("min_border_distance", -1.0),
        ("min_border_distance", math.nan),
    ],
)
def test_parameters_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        MatchingParameters(**{name: value})
