"""The whole thing without Drake: state inside, feedforward by the camera's displacement."""

import math
import subprocess
import sys

import cv2
import numpy as np
import pytest
from synthetic import paper_box, pose, render, rotation

from mffdrake.recognition import (
    CameraRig,
    GeneticParameters,
    Matcher,
    OneStepGaTracker,
    PoseTracker,
    SearchModel,
    TrackingState,
)
from mffdrake.recognition.poses.pose import pose_from_transform, rotation_angle

BOX = paper_box()
RIG = CameraRig.stereo(width=320, height=240)
START = pose((0.02, 0.12, 0.75), (0.1, 0.15, -0.1))


def of(**changes):
    return PoseTracker.of(RIG, BOX, **{"channel_order": "rgb"} | changes)


def swing(frame):
    """X_WC of a hand that shakes by centimeters a frame."""
    angle = 0.08 * math.sin(0.9 * frame)
    R = cv2.Rodrigues(np.array([0.3 * angle, angle, 0.0]))[0]
    return R, np.array([0.04 * math.sin(0.7 * frame), 0.01 * math.cos(frame) - 0.01, 0.0])


def seen(frame):
    """The target at rest, seen from the hand: its pose in C, where it was at START at frame 0."""
    (R0, p0), (R, p) = swing(0), swing(frame)
    return pose_from_transform(R.T @ R0 @ rotation(START[3:]), R.T @ (R0 @ START[:3] + p0 - p))


def displacement(frame):
    """X_DC, from the last frame to this one."""
    (R_WC, p_WC), (R_WD, p_WD) = swing(frame - 1), swing(frame)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R_WD.T @ R_WC, R_WD.T @ (p_WC - p_WD)
    return X


FRAMES = [render(BOX, seen(k), RIG, supersampling=2) for k in range(12)]


def track(tracker, with_motion):
    estimates = [tracker.start(FRAMES[0], START)]
    for k in range(1, len(FRAMES)):
        estimates.append(tracker.track(FRAMES[k], displacement(k) if with_motion else None))
    return estimates


def off(estimate, k):
    return 1e3 * np.linalg.norm(estimate.p_CM - seen(k)[:3])


def test_feedforward_keeps_a_target_that_is_lost_without_it():
    with_motion = track(of(refine=False), True)
    assert max(off(e, k) for k, e in enumerate(with_motion)) < 10.0
    assert off(track(of(refine=False), False)[-1], len(FRAMES) - 1) > 20.0


@pytest.mark.parametrize("with_motion", [True, False])
def test_where_poses_are_refined_the_target_is_kept_either_way(with_motion):
    estimates = track(of(), with_motion)
    assert max(off(e, k) for k, e in enumerate(estimates)) < 2.5
    assert all(e.refined and e.state == TrackingState.TRACKING for e in estimates)


def test_it_is_the_stateless_tracker_with_its_state_kept():
    tracker = of(seed=4)
    algorithm = tracker.algorithm
    generation = algorithm.start_population(FRAMES[0], frame=0)
    first = tracker.start(FRAMES[0])
    np.testing.assert_array_equal(first.pose, generation.best)
    for k in range(1, 5):
        X = displacement(k)
        carried = generation.carried(X[:3, :3], X[:3, 3])
        generation = algorithm.track(carried, FRAMES[k], frame=k)
        estimate = tracker.track(FRAMES[k], X[:3])
        np.testing.assert_array_equal(estimate.pose, generation.best)
        assert estimate.fitness == generation.fitness[0]
        assert estimate.frame == k
    np.testing.assert_array_equal(tracker.generation.poses, generation.poses)


def test_tracking_starts_by_itself_and_starting_again_begins_anew():
    one, other = of(seed=2), of(seed=2)
    np.testing.assert_array_equal(one.track(FRAMES[0]).pose, other.start(FRAMES[0]).pose)
    one.track(FRAMES[1])
    again = one.start(FRAMES[0])
    assert again.frame == 0
    np.testing.assert_array_equal(again.pose, other.start(FRAMES[0]).pose)


def test_images_may_be_given_by_name():
    right, left = FRAMES[0]
    by_name = of().start({"left": left, "right": right}, START)
    np.testing.assert_array_equal(by_name.pose, of().start((right, left), START).pose)


def test_the_standard_deviations_are_those_of_position_and_rotation_vector():
    estimate = track(of(), True)[-1]
    C = estimate.covariance
    assert estimate.std_position == pytest.approx(math.sqrt(np.trace(C[:3, :3])))
    # Drawn from the covariance, the angles to the estimate have that root mean square.
    rng = np.random.default_rng(0)
    poses = estimate.pose + rng.multivariate_normal(np.zeros(6), C, 20_000)
    angles = rotation_angle(poses[:, 3:], estimate.pose[3:])
    assert estimate.std_rotation == pytest.approx(math.sqrt(np.mean(angles**2)), rel=0.03)
    np.testing.assert_allclose(estimate.R_CM, rotation(estimate.pose[3:]), atol=1e-12)
    assert np.linalg.norm(estimate.quaternion_xyzw) == pytest.approx(1.0)


def test_unrefined_poses_have_no_covariance():
    estimate = of(refine=False).start(FRAMES[0], START)
    assert not estimate.refined
    assert np.isnan(estimate.covariance).all()
    assert math.isnan(estimate.std_position) and math.isnan(estimate.std_rotation)


def test_searching_finds_the_target_and_tracking_goes_on_from_there():
    tracker = of(seed=1)
    estimate, found = tracker.search(FRAMES[0], 400)
    assert off(estimate, 0) < 2.5
    assert found.num_generations <= 400
    assert off(tracker.track(FRAMES[1], displacement(1)), 1) < 2.5


def test_a_search_is_judged_where_poses_are():
    """What a search of three generations finds is not relied on unseen; a long one's is."""
    for generations in (3, 400):
        estimate, _ = of(seed=1).search(FRAMES[0], generations)
        assert 0.0 <= estimate.confidence <= 1.0
        assert not estimate.is_tracking or off(estimate, 0) < 2.5
    assert estimate.is_tracking
    blank = [np.full_like(image, 128) for image in FRAMES[0]]
    estimate, _ = of(seed=1).search(blank, 3)
    assert (estimate.is_tracking, estimate.confidence) == (False, 0.0)


def test_by_default_the_target_is_sought_anywhere_in_view():
    """Far outside of the paper's range, turned around, and found in the first frame."""
    for where, turned in (
        ((-0.3, -0.25, 1.1), (0.9, 0.1, 0.2)),
        ((0.35, 0.2, 1.2), (-0.1, 0.7, -0.6)),
        ((-0.05, 0.0, 0.55), (0.2, -0.8, 0.5)),
    ):
        true = pose(where, turned)
        estimate = of(seed=3).start(render(BOX, true, RIG, supersampling=2))
        assert np.linalg.norm(estimate.p_CM - true[:3]) < 0.005
        assert estimate.is_tracking


# The order of the channels


def bgr(images):
    return tuple(image[:, :, ::-1].copy() for image in images)


def test_images_in_opencv_s_order_are_converted_on_request():
    rgb, converted = of(), of(channel_order="bgr")
    for k in range(4):
        X = None if k == 0 else displacement(k)
        one = rgb.start(FRAMES[k], START) if k == 0 else rgb.track(FRAMES[k], X)
        images = bgr(FRAMES[k])
        other = converted.start(images, START) if k == 0 else converted.track(images, X)
        np.testing.assert_array_equal(one.pose, other.pose)


def test_images_in_the_other_order_are_refused_where_the_pose_is_known():
    with pytest.raises(ValueError, match=r"order bgr \(fitness .*\) than in the order rgb"):
        of().start(bgr(FRAMES[0]), START)
    with pytest.raises(ValueError, match="channel_order='rgb'"):
        of(channel_order="bgr").start(FRAMES[0], START)


def test_the_order_must_be_stated():
    with pytest.raises(TypeError, match="channel_order"):
        PoseTracker.of(RIG, BOX)
    with pytest.raises(ValueError, match="channel_order must be one of rgb, bgr, not 'rgba'"):
        of(channel_order="rgba")


# Mistakes


@pytest.mark.parametrize("X", [np.eye(3), np.zeros((2, 4)), np.full((4, 4), np.nan), [1.0]])
def test_a_displacement_that_is_no_transform_is_an_error(X):
    tracker = of()
    tracker.start(FRAMES[0])
    with pytest.raises(ValueError, match="X_DC must be a finite transform"):
        tracker.track(FRAMES[1], X)


def test_a_frame_that_fails_changes_nothing():
    tracker, untouched = of(), of()
    for t in (tracker, untouched):
        t.start(FRAMES[0], START)
    with pytest.raises(ValueError, match="camera 'left'"):
        tracker.track((FRAMES[1][0], FRAMES[1][1][:100]))
    np.testing.assert_array_equal(tracker.track(FRAMES[1]).pose, untouched.track(FRAMES[1]).pose)


def test_it_works_where_there_is_no_drake():
    code = (
        "import sys\n"
        "class No:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name.split('.')[0] == 'pydrake': raise ImportError('no Drake here')\n"
        "sys.meta_path.insert(0, No())\n"
        "import numpy as np\n"
        "from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, PoseTracker, SolidModel\n"
        "box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))\n"
        "tracker = PoseTracker.of(CameraRig.stereo(), box, channel_order='rgb')\n"
        "print(tracker.track(2 * [np.zeros((480, 640, 3), np.uint8)]).frame)\n"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert finished.stdout == "0\n", finished.stderr


def test_any_algorithm_can_be_wrapped():
    algorithm = OneStepGaTracker(
        matcher=Matcher(SearchModel(BOX), RIG), parameters=GeneticParameters(population_size=20)
    )
    tracker = PoseTracker(algorithm)
    tracker.start(FRAMES[0])
    assert tracker.generation.poses.shape == (20, 6)
