"""In aliased images, the pose in the middle of all that draw the same borders."""

import math

import numpy as np
import pytest
from synthetic import paper_box, pose, render

from mffdrake.recognition import BorderRefiner, CameraRig, Matcher, SearchModel
from mffdrake.recognition.poses import rotations
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.recognition.refinement import borders as borders_module
from mffdrake.recognition.refinement import centering, edge_lines
from mffdrake.recognition.refinement import gauss_newton as border_residuals

BOX = paper_box()
RIG = CameraRig.stereo()
REFINER = BorderRefiner(Matcher(SearchModel(BOX), RIG))


def some_pose(rng, degrees):
    """A pose near the paper's, turned by about so many degrees from the pixels' rows."""
    position = np.array([0.0, 0.155, 0.8]) + rng.normal(0.0, 0.02, 3)
    return pose(position, rotate_by(rng.normal(0.0, math.radians(degrees), 3)))


def found(psi, images):
    """Scene, lines and inliers at a pose."""
    scene = REFINER.matcher.scene(images)
    lines = edge_lines.edge_lines(psi, scene.solid, scene.views)
    stage, rules = borders_module.Stage(3, 1, 8), REFINER.rules
    borders = borders_module.find_borders(psi, lines, scene, rules, stage)[0].copy()
    borders["weight"] = 1.0
    return scene, lines, borders


def distances(psi, lines, walls, scene):
    residuals, J = np.empty(len(walls)), np.empty((len(walls), 6))
    border_residuals.linearize(psi, lines, walls, scene, residuals, J)
    return residuals, J


@pytest.mark.parametrize("degrees", [0.0, 0.3, 8.0])
def test_the_walls_are_the_ends_of_the_runs_at_one_pixel(degrees):
    psi = some_pose(np.random.default_rng(1), degrees)
    _, _, borders = found(psi, render(BOX, psi, RIG))
    walls = centering.find_walls(borders)
    expected = []
    for line in np.unique(borders["line"]):
        rows = borders[borders["line"] == line]
        pixels = np.floor(rows["across"])
        for k in range(len(rows)):
            inner = 0 < k < len(rows) - 1 and (
                pixels[k - 1] == pixels[k] == pixels[k + 1]
                and rows["along"][k + 1] - rows["along"][k - 1] == 2
            )
            if not inner:
                expected.append((line, rows["along"][k], pixels[k] + 0.5))
    assert [(w["line"], w["along"], w["across"]) for w in walls] == expected
    assert len(walls) < len(borders)


@pytest.mark.parametrize("degrees", [0.0, 0.3, 8.0])
def test_the_true_pose_is_within_the_walls_and_the_center_is_the_barrier_s_least(degrees):
    rng = np.random.default_rng(2)
    for _ in range(4):
        psi = some_pose(rng, degrees)
        scene, lines, borders = found(psi, render(BOX, psi, RIG))
        walls = centering.find_walls(borders)
        residuals, J = distances(psi, lines, walls, scene)
        assert np.abs(residuals).max() < 0.5 + 1e-9
        centered, x, covariance = centering.center(psi, lines, borders, scene)
        assert centered
        w = centering.HALF

        def barrier(move, r=residuals, J=J, w=w):
            c = r - J @ move
            return np.inf if np.abs(c).max() >= w else -np.log(w * w - c * c).sum()

        least = barrier(x)
        assert np.isfinite(least)
        L = np.linalg.cholesky(covariance)
        for direction in rng.normal(size=(50, 6)):
            assert barrier(x + 0.3 * L @ direction) > least
        # The covariance is the inverse of the barrier's second derivative.
        c = residuals - J @ x
        H = (J.T * (1.0 / (w - c) ** 2 + 1.0 / (w + c) ** 2)) @ J
        scale = np.sqrt(np.diag(H))
        inverse = np.linalg.inv(covariance)
        np.testing.assert_allclose(
            inverse / np.outer(scale, scale), H / np.outer(scale, scale), atol=0.1
        )


def test_the_center_does_not_depend_on_where_the_steps_begin():
    rng = np.random.default_rng(3)
    psi = some_pose(rng, 1.0)
    scene, lines, borders = found(psi, render(BOX, psi, RIG))
    _, x, covariance = centering.center(psi, lines, borders, scene)
    start = rotations.move(psi, np.linalg.cholesky(covariance) @ rng.normal(size=6))
    edge_lines.move_lines(lines, start, scene.solid, scene.views, True)
    centered, y, _ = centering.center(start, lines, borders, scene)
    assert centered
    one, other = rotations.move(psi, x), rotations.move(start, y)
    apart = one - other
    spread = np.sqrt(np.diag(covariance))
    assert (np.abs(apart[:3]) < 0.1 * spread[:3]).all()


def test_borders_that_contradict_each_other_have_no_center():
    psi = some_pose(np.random.default_rng(4), 0.3)
    scene, lines, borders = found(psi, render(BOX, psi, RIG))
    line = borders["line"][0]
    borders["across"][borders["line"] == line] += np.where(
        np.arange((borders["line"] == line).sum()) % 2, 2.0, -2.0
    )
    assert not centering.center(psi, lines, borders, scene)[0]
    assert not centering.center(psi, lines, borders[:5], scene)[0]


def test_along_the_box_s_axes_a_refined_pose_is_as_good_as_such_images_allow():
    """Before there was a center: 0.9 mm. The poses that draw the same image scatter by 0.6 mm."""
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(24):
        psi = some_pose(rng, 0.0)
        start = psi + np.concatenate([rng.normal(0, 0.001, 3), rng.normal(0, 0.002, 3)])
        result = REFINER.refine(start, render(BOX, psi, RIG))
        if result.converged:
            errors.append(1e3 * (result.pose - psi)[:3])
    assert len(errors) >= 20
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 0.12 and rms[1] < 0.12 and rms[2] < 0.9, rms
