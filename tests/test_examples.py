"""The examples work, and the page on trackers of one's own is true."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mffdrake as mff

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "own_tracker.md").read_text(encoding="utf-8")
RIG = mff.CameraRig.stereo()
POSE = np.array([0.0, 0.155, 0.8, 0.0, 0.0, 0.0])
GREY = np.full((480, 640, 4), 128, dtype=np.uint8)


@pytest.fixture(scope="module")
def example():
    """The module of examples/pnp_tracker.py."""
    path = ROOT / "examples" / "pnp_tracker.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # where dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[path.stem]


@pytest.fixture
def tracker(example):
    box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
    return example.PnpTracker(rig=RIG, solid=box, initial_pose=POSE)


def track(example, motion, *, method):
    """Errors of the position [m] of every frame, and the fitness."""
    scenario = mff.LoadScenario(text=example.ONE_CAMERA + motion)
    scenario = mff.Change(scenario, {"method": method, "duration": 1.5})
    result, view = example.Track(scenario)
    assert view.shape == (480, 640, 3)
    error = np.linalg.norm((result.recognized_pose - result.true_pose)[:, :3], axis=1)
    return error, result.fitness


# Face corners and solvePnP


@pytest.mark.parametrize("method", ["mff", "ga"])
def test_corners_track_the_box_along_the_papers_path(example, method):
    error, fitness = track(example, "hand_path: {omega: 0.314}", method=method)
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert fitness.min() > 0.5


def test_where_the_hand_shakes_corners_need_the_feedforward(example):
    with_it, _ = track(example, example.SHAKING_HAND, method="mff")
    without, _ = track(example, example.SHAKING_HAND, method="ga")
    assert with_it.max() < 0.010
    assert without.max() > 2.0 * with_it.max()


@pytest.mark.parametrize(
    "pose",
    [
        POSE,
        POSE + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0],  # half of the box beside the image
        POSE + [3.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # all of it
        POSE * [1.0, 1.0, -1.0, 1.0, 1.0, 1.0],  # behind the camera
    ],
)
def test_where_nothing_is_seen_the_carried_pose_stays(tracker, pose):
    carried = mff.Generation(pose[None], np.ones(1))
    generation = tracker.track(carried, [GREY, GREY], frame=1)
    np.testing.assert_array_equal(generation.poses, pose[None])
    np.testing.assert_array_equal(generation.fitness, [0.0])
    assert generation.covariance is None


def test_a_lens_that_bends_edges_is_refused(example, tracker):
    bent = mff.Camera(
        width=640, height=480, fx=580, fy=580, cx=319.5, cy=239.5,
        distortion=mff.Distortion("plumb_bob", (-0.2, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    with pytest.raises(ValueError, match="'camera': distortion must be .* none, not plumb_bob"):
        example.PnpTracker(rig=mff.CameraRig([bent]), solid=tracker.solid, initial_pose=POSE)


# The page


@pytest.mark.parametrize("program", re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL))
def test_programs_run(program, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_links_lead_somewhere():
    links = re.findall(r"\]\(([^)]+)\)", PAGE)
    assert links
    for link in links:
        assert (ROOT / "docs" / link).exists(), link
