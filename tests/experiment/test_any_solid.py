"""Solids of all kinds are found and tracked in simulation."""

import colorsys

import numpy as np
import pytest
import trimesh

from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.poses.pose import rotation_angle

NAMES = ("wedge", "hexagonal_prism", "l_block", "notched_box", "hammer", "mug")


def track(model, **more):
    """A short run on the paper's path: positions' errors [m], and what was recorded."""
    scenario = Change(
        Scenario(),
        {
            "renderer": "flat", "method": "mff", "duration": 1.2, "seed": 11,
            "hand_path.omega": 0.314, "recognizer.refinement": "borders", "target.model": model,
        } | more,
    )  # fmt: skip
    result = Simulate(scenario)
    distance = np.linalg.norm(result.true_pose[:, :3] - result.recognized_pose[:, :3], axis=1)
    return distance, result


@pytest.mark.parametrize("name", NAMES)
def test_it_is_found_anywhere_and_tracked_on_the_paper_s_path(name):
    distance, result = track(f"package://mffdrake/{name}.sdf")
    assert (distance[10:] < 2e-3).all() and np.median(distance[10:]) < 5e-4
    assert result.is_tracking[10:].mean() > 0.8
    assert result.fitness[10:].min() > 0.9


def painted(mesh, path, *hues):
    """Writes a mesh with bands of colors from below to above, and an SDF of it."""
    height = mesh.triangles_center[:, 2]
    share = (height - height.min()) / np.ptp(height)
    band = np.minimum((share * len(hues)).astype(int), len(hues) - 1)
    colors = [colorsys.hsv_to_rgb(hues[k] / 360.0, 1.0, 1.0) for k in band]
    mesh.visual.face_colors = np.rint(255 * np.array(colors)).astype(np.uint8)
    mesh.export(path.with_suffix(".ply"))
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='l'><visual name='v'><geometry><mesh>"
        f"<uri>{path.stem}.ply</uri></mesh></geometry></visual></link></model></sdf>"
    )
    return str(path)


def test_a_can_so_smooth_that_nothing_tells_how_it_is_turned_is_known_for_sure(tmp_path):
    mesh = trimesh.creation.cylinder(0.045, 0.15, sections=400)
    distance, result = track(painted(mesh, tmp_path / "can.sdf", 0, 120, 120, 240), duration=0.6)
    assert "any turn about (0, 0, 1)" in str(result.symmetries)
    assert np.median(distance) < 5e-4 and distance.max() < 2e-3
    assert result.is_tracking.mean() > 0.9
    # It is the pose turned least against the last one that is told.
    turned = rotation_angle(result.recognized_pose[1:, 3:], result.recognized_pose[:-1, 3:])
    assert turned.max() < np.radians(1.0)


def test_a_ball_of_one_color_has_a_place(tmp_path):
    mesh = trimesh.creation.icosphere(3, 0.06)
    distance, result = track(painted(mesh, tmp_path / "ball.sdf", 0), duration=0.6)
    assert str(result.symmetries) == "any turn"
    assert np.median(distance) < 2e-3 and distance.max() < 6e-3
    assert result.is_tracking.mean() > 0.9


def test_what_is_round_everywhere_is_placed_by_its_outline(tmp_path):
    mesh = trimesh.creation.capsule(0.1, 0.04, count=[32, 32])
    distance, result = track(painted(mesh, tmp_path / "pill.sdf", 240, 120, 0), duration=0.6)
    assert np.median(distance) < 7e-4 and distance.max() < 3e-3
    assert result.is_tracking.mean() > 0.9
