"""Poses found in one set of images from nothing, over all orientations."""

import dataclasses as dc
import math

import cv2
import numpy as np
import pytest
from synthetic import render, rotation

from mffdrake.recognition import (
    BorderRefiner,
    Camera,
    CameraRig,
    ColoredStart,
    Distortion,
    GeneCoding,
    Matcher,
    OneStepGaTracker,
    PoseSearch,
    RandomStart,
    SearchModel,
    SearchParameters,
    SearchRange,
    SolidModel,
)
from mffdrake.recognition.poses.pose import pose_from_transform, rotation_angle
from mffdrake.recognition.solid.symmetry import turn_about_middle

HUES = np.radians([0.0, 60.0, 120.0, 180.0, 240.0, 300.0])
RANGE = SearchRange(
    x=(-0.2, 0.2), y=(-0.2, 0.2), z=(-0.05, 0.2), eps1=(-1, 1), eps2=(-1, 1), eps3=(-1, 1)
)


def six_colored(size):
    box = SolidModel.box(size, (0.0, 0.0, 0.0))
    return SolidModel(box.vertices, box.faces, HUES)


def looking_at_the_middle(name, degrees):
    """A distorted camera half a meter from the world's origin, looking down at it."""
    angle = math.radians(degrees)
    p_CK = 0.5 * np.array([math.cos(angle), math.sin(angle), 1.0]) / math.sqrt(2.0)
    z = -p_CK / np.linalg.norm(p_CK)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return Camera(
        name=name, width=320, height=320, fx=340.0, fy=345.0, cx=163.0, cy=157.0,
        distortion=Distortion("plumb_bob", (-0.24, 0.11, -0.003, 0.0, -0.03)),
        R_CK=np.column_stack([x, np.cross(z, x), z]), p_CK=p_CK,
    )  # fmt: skip


RIG = CameraRig(tuple(looking_at_the_middle(f"c{k}", 60.0 + 120.0 * k) for k in range(3)))


def tracker(solid, rig=RIG, **changes):
    matcher = Matcher(SearchModel(solid), rig)
    coding = GeneCoding(search_range=RANGE)
    return OneStepGaTracker(
        **{"matcher": matcher, "coding": coding, "refiner": BorderRefiner(matcher)} | changes
    )


def random_pose(rng):
    axis = rng.normal(size=3)
    R = cv2.Rodrigues(axis / np.linalg.norm(axis) * rng.uniform(0, math.pi))[0]
    return pose_from_transform(R, rng.uniform([-0.08, -0.08, 0.0], [0.08, 0.08, 0.08]))


@pytest.mark.parametrize("size", [(0.065, 0.065, 0.065), (0.03, 0.03, 0.09), (0.05, 0.07, 0.1)])
def test_it_finds_any_pose_over_all_orientations(size):
    solid = six_colored(size)
    rng = np.random.default_rng(7)
    for seed in range(3):
        truth = random_pose(rng)
        images = render(solid, truth, RIG, supersampling=2)
        found = PoseSearch(tracker(solid, seed=seed)).search(images, 500)
        best = found.generation.best
        assert np.linalg.norm(best[:3] - truth[:3]) < 0.001
        assert rotation_angle(best[3:], truth[3:]) < 0.02
        assert found.generation.covariance is not None
        assert found.num_generations <= 500


def test_the_same_seed_gives_the_same_bits_and_another_another_way():
    solid = six_colored((0.05, 0.07, 0.1))
    images = render(solid, random_pose(np.random.default_rng(1)), RIG)
    one, same, other = (
        PoseSearch(tracker(solid, seed=seed)).search(images, 60) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.generation.poses, same.generation.poses)
    assert (one.generation.poses != other.generation.poses).any()


def test_it_ends_when_rounds_agree_and_otherwise_with_the_generations():
    solid = six_colored((0.05, 0.07, 0.1))
    images = render(solid, random_pose(np.random.default_rng(2)), RIG)
    counted = []
    search = PoseSearch(tracker(solid))
    found = search.search(
        images, 2000, on_generation=lambda n, fitness: counted.append((n, fitness))
    )
    assert found.converged and found.num_generations < 2000
    assert [n for n, _ in counted] == list(range(1, found.num_generations + 1))
    assert found.num_rounds >= SearchParameters().agreement
    short = search.search(images, 30)
    assert not short.converged and short.num_generations == 30


def test_without_the_target_nothing_is_found_and_nothing_is_sure():
    solid = six_colored((0.05, 0.07, 0.1))
    grey = [np.full((320, 320, 3), 128, dtype=np.uint8)] * 3
    found = PoseSearch(tracker(solid)).search(grey, 100)
    assert found.generation.fitness[0] == 0.0
    assert found.generation.covariance is None


def test_a_quarter_turn_of_a_cube_is_tried_and_taken():
    """Without the turns, a population around the cube turned wrongly stays there."""
    solid = six_colored((0.065, 0.065, 0.065))
    truth = random_pose(np.random.default_rng(5))
    images = render(solid, truth, RIG, supersampling=2)
    algorithm = tracker(solid)
    R = rotation(truth[3:])
    wrong = pose_from_transform(R @ cv2.Rodrigues(np.array([0.0, 0.0, math.pi / 2]))[0], truth[:3])
    search = PoseSearch(algorithm)
    turned = turn_about_middle(wrong, solid, search.turns)
    angles = rotation_angle(turned[:, 3:], truth[3:])
    assert angles.min() < 1e-6
    best = turned[np.argmax(algorithm.matcher.fitness(turned, images))]
    assert rotation_angle(best[3:], truth[3:]) < 1e-6


# Starts where colors are


def test_a_colored_start_draws_where_the_images_show_the_solid():
    solid = six_colored((0.05, 0.07, 0.1))
    truth = random_pose(np.random.default_rng(3))
    images = render(solid, truth, RIG)
    algorithm = tracker(solid)
    scene = algorithm.matcher.scene(images)
    draw = {
        kind: kind().draw(algorithm.algorithm, np.random.default_rng(0), algorithm.matcher, scene)
        for kind in (ColoredStart, RandomStart)
    }
    counts = {kind: algorithm.matcher.middle_shown(poses, scene) for kind, poses in draw.items()}
    assert (counts[ColoredStart] == 3).mean() > 5 * (counts[RandomStart] == 3).mean()
    assert len(draw[ColoredStart]) == len(draw[RandomStart])
    # Counted one by one: the pixel at the middle's projection has a color.
    for psi, count in zip(draw[RandomStart][:200], counts[RandomStart], strict=False):
        seen = 0
        for camera, image in zip(RIG.cameras, images, strict=True):
            u, v = np.floor(camera.project(psi[:3]) + 0.5)
            inside = 0 <= u < camera.width and 0 <= v < camera.height
            seen += inside and np.ptp(image[int(v), int(u)].astype(int)) > 60
        assert seen == count


# Mistakes


@pytest.mark.parametrize("name", ["patience", "turn_every", "agreement"])
def test_parameters_out_of_range_are_named(name):
    with pytest.raises(ValueError, match=f"SearchParameters: {name} must be at least 1, not 0"):
        SearchParameters(**{name: 0})


def test_no_generations_is_an_error():
    solid = six_colored((0.05, 0.07, 0.1))
    with pytest.raises(ValueError, match="generations must be at least 1, not 0"):
        PoseSearch(dc.replace(tracker(solid))).search([], 0)
