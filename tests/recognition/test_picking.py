"""The choice of the best poses that differ from each other."""

import math

import cv2
import numpy as np
import pytest
import trimesh
from synthetic import paper_box, pose, random_poses, rotation, tetrahedron

from mffdrake.recognition import Camera, CameraRig, Matcher, SearchModel, SolidModel

_picking = pytest.importorskip("mffdrake.recognition.acquisition.picking")
_random_numbers = pytest.importorskip("mffdrake.recognition.genetic.random_numbers")
_proposals = pytest.importorskip("mffdrake.recognition.acquisition.proposing")


def pick(poses, scores, origins, weights, numbers, apart, seed=0):
    sources = np.zeros(len(weights), dtype=_proposals.SOURCE)
    sources["weight"] = weights
    rng = np.random.default_rng(seed)
    return _picking.pick_distinct(
        poses, scores, origins, sources, numbers, apart, _random_numbers.address_of(rng)
    )


def same(a, b, apart):
    distance, cosine = apart
    half = math.cos(0.5 * np.linalg.norm(cv2.Rodrigues(rotation(a[3:]).T @ rotation(b[3:]))[0]))
    return np.linalg.norm(a[:3] - b[:3]) < distance and half > cosine


def random_choice(seed, count=80):
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-0.1, 0.1, size=(count, 6))
    scores = np.where(rng.random(count) < 0.2, 0.0, np.round(rng.random(count), 3))
    return poses, scores + 1e-7 * np.arange(count) * (scores > 0.0), rng.integers(-1, 9, count)


@pytest.mark.parametrize("seed", range(5))
def test_the_best_distinct_ones_are_picked(seed):
    poses, scores, origins = random_choice(seed)
    apart = (0.08, math.cos(math.radians(7.0)))
    picked = pick(poses, scores, origins, np.ones(9), (12, 0), apart)
    expected = []
    for n in np.argsort(-scores):
        if scores[n] > 0.0 and not any(same(poses[n], poses[k], apart) for k in expected):
            expected.append(n)
    assert expected[:12] != list(np.argsort(-scores)[:12])
    np.testing.assert_array_equal(picked, expected[:12])


@pytest.mark.parametrize("seed", range(5))
def test_those_that_are_drawn_are_the_best_of_different_sources(seed):
    poses, scores, origins = random_choice(seed)
    apart = (0.05, math.cos(math.radians(5.0)))
    picked = pick(poses, scores, origins, np.ones(9), (10, 6), apart, seed)
    assert len(picked) == 10
    np.testing.assert_array_equal(picked[:4], pick(poses, scores, origins, [1.0], (4, 0), apart))
    assert len(set(origins[picked[4:]])) == 6 and origins[picked[4:]].min() >= 0
    for k in range(4, 10):
        rivals = [
            n for n in np.flatnonzero((origins == origins[picked[k]]) & (scores > 0.0))
            if not any(same(poses[n], poses[m], apart) for m in picked[:k])
        ]  # fmt: skip
        assert picked[k] == max(rivals, key=lambda n: scores[n])
    other = pick(poses, scores, origins, np.ones(9), (10, 6), apart, seed + 50)
    assert list(other) != list(picked)


def test_sources_are_drawn_by_their_weights():
    poses, scores = np.zeros((3, 6)), np.array([0.3, 0.2, 0.1])
    poses[:, 0] = [0.0, 1.0, 2.0]
    drawn = [
        pick(poses, scores, np.arange(3), [0.1, 0.2, 0.7], (1, 1), (0.1, 0.9), seed)[0]
        for seed in range(600)
    ]
    np.testing.assert_allclose(np.bincount(drawn) / 600.0, [0.1, 0.2, 0.7], atol=0.06)


def test_what_scores_nothing_is_never_picked():
    poses, scores, origins = random_choice(9)
    apart = (1e-6, 1.0 - 1e-12)
    picked = pick(poses, scores, origins, np.ones(9), (80, 9), apart)
    assert scores[picked].min() > 0.0 and len(set(picked)) == len(picked)
    assert len(picked) == (scores > 0.0).sum()
    assert len(pick(poses, 0.0 * scores, origins, np.ones(9), (80, 9), apart)) == 0
    assert len(pick(poses[:0], scores[:0], origins[:0], [], (20, 10), apart)) == 0


def egg():
    """A smooth body of a thousand faces of one color."""
    triangles = trimesh.creation.icosphere(3).triangles * [0.05, 0.07, 0.09]
    return SolidModel.from_triangles(triangles, np.zeros(len(triangles)), len(triangles) * ["red"])


@pytest.mark.parametrize("solid", [paper_box(), tetrahedron(), egg()])
def test_a_silhouettes_area_is_that_of_the_hull_of_its_corners(solid):
    """Far away, its solid angle is its area in the image of a camera that looks at it."""
    rig = CameraRig((Camera(width=640, height=480, fx=500.0, fy=500.0, cx=320.0, cy=240.0),))
    matcher = Matcher(SearchModel(solid), rig)
    scene = matcher.scene([np.zeros((480, 640, 3), dtype=np.uint8)])
    turns = random_poses(np.random.default_rng(3), 20)[:, 3:]
    poses = np.array([pose((0.0, 0.0, 40.0), eps) for eps in turns])
    expected = []
    for psi in poses:
        corners = solid.vertices @ rotation(psi[3:]).T + psi[:3]
        outline = cv2.convexHull((1000.0 * corners[:, :2] / corners[:, 2:]).astype(np.float32))
        expected.append(1e-6 * cv2.contourArea(outline))
    found = _picking.silhouette_areas(poses, scene, solid.facets)
    np.testing.assert_allclose(found, expected, rtol=0.01)
    # Two cameras in one place see twice as much.
    twice = scene._replace(views=2 * scene.views)
    np.testing.assert_allclose(
        _picking.silhouette_areas(poses, twice, solid.facets), 2.0 * found, rtol=1e-12
    )
