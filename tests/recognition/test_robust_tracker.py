"""The tracker that finds its target at once, knows when it has lost it, and comes back."""

import dataclasses as dc
import math

import numpy as np
import pytest
from synthetic import GREY, PAPER_POSITION, pose, render

from mffdrake.recognition import (
    AcquisitionParameters,
    BorderRefiner,
    CameraRig,
    GeneCoding,
    Matcher,
    NearStart,
    OneStepGaTracker,
    RobustTracker,
    SearchModel,
    SearchRange,
    SolidModel,
    TrackingState,
)
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.poses.pose_motion import transport_pose

RIG = CameraRig.stereo(width=320, height=240)
BOX = SolidModel.box((0.1, 0.15, 0.2), (0.0, 2 * math.pi / 3, 4 * math.pi / 3))
SIX = SolidModel(BOX.vertices, BOX.faces, np.array([0, 3, 2, 5, 4, 1]) * math.pi / 3)
ALL = SearchRange(eps1=(-1, 1), eps2=(-1, 1), eps3=(-1, 1))
ASKEW = pose(PAPER_POSITION, (0.15, 0.25, 0.1))
NOTHING = (np.full((240, 320, 3), GREY, dtype=np.uint8),) * 2


def make(solid=BOX, rig=RIG, search_range=None, **parameters):
    matcher = Matcher(SearchModel(solid), rig)
    coding = GeneCoding(search_range=search_range or SearchRange())
    ga = OneStepGaTracker(matcher=matcher, coding=coding, refiner=BorderRefiner(matcher), seed=7)
    return RobustTracker(ga=ga, parameters=AcquisitionParameters(**parameters))


def see(psi, solid=BOX, rig=RIG):
    return render(solid, psi, rig, supersampling=2)


def is_right(generation, psi):
    apart = np.linalg.norm(generation.best[:3] - psi[:3])
    return apart < 0.003 and rotation_angle(generation.best[3:], psi[3:]) < math.radians(0.6)


def moving(k, step=(0.004, -0.002, 0.003), turn=0.0):
    """A target's pose at frame k: so far a frame [m], and a turn about y [rad]."""
    half = 0.5 * turn * k
    start = np.array([-0.05, 0.16, 0.78]) + k * np.array(step)
    return pose(start, (0.15, math.sin(half + 0.1), 0.05))


@pytest.fixture(scope="module")
def tracker():
    return make()


@pytest.fixture(scope="module")
def found(tracker):
    return tracker.start_population(see(ASKEW))


# Found


def test_it_finds_the_target_in_the_first_frame_and_says_so(found):
    assert is_right(found, ASKEW)
    assert found.state == TrackingState.TRACKING and found.is_tracking
    assert found.confidence > 0.9
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize("search_range", [None, ALL], ids=["usual", "all orientations"])
def test_one_camera_is_enough(search_range):
    single = CameraRig(RIG.cameras[:1])
    found = make(SIX, single, search_range).start_population(see(ASKEW, SIX, single))
    assert found.is_tracking and is_right(found, ASKEW)


def test_where_nothing_is_to_be_seen_it_searches(tracker):
    generation = tracker.start_population(NOTHING)
    for frame in (1, 2):
        generation = tracker.track(generation, NOTHING, frame=frame)
        assert generation.state == TrackingState.SEARCHING and not generation.is_tracking
        assert generation.confidence == 0.0 and generation.covariance is None


def test_a_known_start_is_one_of_the_places_where_it_looks():
    near = make().with_start(NearStart(ASKEW))
    assert is_right(near.start_population(see(ASKEW)), ASKEW)


def test_the_same_arguments_give_the_same_result(tracker, found):
    again = tracker.start_population(see(ASKEW))
    np.testing.assert_array_equal(again.poses, found.poses)
    images = see(moving(1))
    one, other = (tracker.track(found, images, frame=1) for _ in range(2))
    np.testing.assert_array_equal(one.poses, other.poses)
    assert one.confidence == other.confidence


def test_the_other_half_of_a_look_alike_is_told_by_a_glimpse_of_another_color():
    """Head-on, a box turned by a half about the line of sight has the same outline."""
    tracker = make(SIX, search_range=ALL)
    glimpse = pose((0.0, 0.155, 0.8), (0.0, 0.10, 0.0))
    found = tracker.start_population(see(glimpse, SIX))
    assert found.is_tracking and is_right(found, glimpse)


@pytest.mark.parametrize("apart", [0.008, 0.015, 0.03])
def test_cameras_that_are_out_of_step_are_not_relied_on(apart):
    """They show the target in different places: neither is where the other has it."""
    tracker, moved = make(), ASKEW + [apart, 0.0, 0.0, 0.0, 0.0, 0.0]
    images = (see(ASKEW)[0], see(moved)[1])
    generation = tracker.start_population(images)
    for k in range(1, 4):
        assert not generation.is_tracking or is_right(generation, ASKEW)
        generation = tracker.track(generation, images, frame=k)


def test_a_target_behind_a_bar_is_relied_on():
    tracker = make()
    images = [image.copy() for image in see(ASKEW)]
    for image in images:
        rows = np.flatnonzero((image != GREY).any(axis=(1, 2)))
        image[int(np.quantile(rows, 0.6)) :] = 90  # It hides the lower part.
    generation = tracker.start_population(images)
    for k in range(1, 4):
        generation = tracker.track(generation, images, frame=k)
    assert generation.is_tracking and is_right(generation, ASKEW)


def test_a_rectangle_alone_does_not_tell_which_way_a_wedge_is_turned():
    """Its base is seen straight on, and nothing else of it: turned by a half it looks the same."""
    ends = [(x, y, -0.1) for x, y in ((-0.1, -0.07), (0.1, -0.07), (0.1, 0.07), (-0.1, 0.07))]
    corners = [*ends, (-0.1, -0.07, 0.1), (-0.1, 0.07, 0.1)]
    faces = [(0, 3, 2, 1), (0, 1, 4), (1, 2, 5, 4), (2, 3, 5), (0, 4, 5, 3)]
    wedge = SolidModel(corners, faces, np.radians(72.0 * np.arange(5)))
    rig = CameraRig.stereo()  # The base is wider than the cameras' distance.
    head_on = pose((-0.075, 0.02, 0.9), (0.0, 0.0, 0.1))
    generation = make(wedge, rig, ALL).start_population(see(head_on, wedge, rig))
    assert generation.state == TrackingState.AMBIGUOUS and not generation.is_tracking


def test_where_one_face_alone_is_seen_the_pose_is_ambiguous_until_another_shows():
    slab = SolidModel.box((0.2, 0.15, 0.05), (0.0, 1.0, 2.0))  # wider than the cameras' distance
    slab = SolidModel(slab.vertices, slab.faces, SIX.hues)
    rig = CameraRig.stereo()
    tracker = make(slab, rig, ALL)
    head_on = pose((-0.075, 0.02, 0.8), (0.0, 0.0, 0.1))
    generation = tracker.start_population(see(head_on, slab, rig))
    assert generation.state == TrackingState.AMBIGUOUS and not generation.is_tracking
    assert generation.covariance is None and generation.confidence == 0.0
    for k in range(1, 6):
        psi = pose(head_on[:3], (0.03 * k, 0.02 * k, 0.1))
        generation = tracker.track(generation, see(psi, slab, rig), frame=k)
    assert generation.state == TrackingState.TRACKING and is_right(generation, psi)


# Followed


def test_a_jump_of_centimeters_is_followed_in_its_frame(tracker, found):
    jumped = pose(ASKEW[:3] + [0.035, -0.02, 0.04], ASKEW[3:] + [0.05, -0.05, 0.05])
    generation = tracker.track(found, see(jumped), frame=1)
    assert generation.state == TrackingState.TRACKING and is_right(generation, jumped)


def test_the_targets_own_motion_is_learned_and_carries_the_pose(tracker):
    generation = tracker.start_population(see(moving(0, turn=0.02)))
    for k in range(1, 8):
        generation = tracker.track(generation, see(moving(k, turn=0.02)), frame=k)
        assert generation.state == TrackingState.TRACKING
        assert is_right(generation, moving(k, turn=0.02))
    np.testing.assert_allclose(generation.motion.velocity[:3], [0.004, -0.002, 0.003], atol=1e-3)
    for k in range(8, 12):
        generation = tracker.track(generation, NOTHING, frame=k)
    assert generation.state == TrackingState.PREDICTED and generation.unseen == 4
    assert np.linalg.norm(generation.best[:3] - moving(11)[:3]) < 0.004


def test_feedforward_and_the_targets_own_motion_add_up(tracker):
    """The hand moves 20 mm a frame, the target 4 mm; fed forward, only the latter is learned."""
    hand = np.array([0.02, 0.0, 0.0])
    own = [moving(k) for k in range(6)]
    seen = [pose(psi[:3] - k * hand, psi[3:]) for k, psi in enumerate(own)]
    generation = tracker.start_population(see(seen[0]))
    for k in range(1, 6):
        generation = generation.carried(np.eye(3), -hand)
        generation = tracker.track(generation, see(seen[k]), frame=k)
        assert is_right(generation, seen[k])
    np.testing.assert_allclose(generation.motion.velocity[:3], [0.004, -0.002, 0.003], atol=1e-3)


def test_a_target_that_turns_back_looks_the_same_twice_and_is_tracked(tracker):
    """Thrown up, it is at the same place one frame before and one after its highest point."""
    low = np.array([0.0, 0.0004, 0.0, 0.0, 0.0, 0.0])
    thrown = [moving(0) + low * (k - 9.5) ** 2 for k in range(20)]
    generation = tracker.start_population(see(thrown[0]))
    for k, psi in enumerate(thrown[1:], start=1):
        generation = tracker.track(generation, see(psi), frame=k)
        assert generation.state == TrackingState.TRACKING, k
        assert is_right(generation, psi), k


def test_a_jump_is_believed_at_the_second_frame_though_all_is_at_rest_again(tracker, found):
    """Without noise, the images of a target at rest are the same, as those of a frozen camera."""
    generation, still, jumped = found, see(ASKEW), see(moving(0))
    for k in range(1, 10):
        generation = tracker.track(generation, still, frame=k)
    generation = tracker.track(generation, jumped, frame=10)
    assert not generation.is_tracking
    for k in range(11, 14):
        generation = tracker.track(generation, jumped, frame=k)
        assert generation.state == TrackingState.TRACKING and is_right(generation, moving(0))


# Not seen


def test_a_hidden_target_is_predicted_then_lost_then_found_again(tracker, found):
    generation, confidence = found, found.confidence
    for k in range(1, 31):
        generation = tracker.track(generation, NOTHING, frame=k)
        assert generation.state == TrackingState.PREDICTED
        assert generation.confidence <= confidence
        confidence = generation.confidence
    assert not generation.is_tracking
    generation = tracker.track(generation, NOTHING, frame=31)
    assert generation.state == TrackingState.LOST and generation.confidence == 0.0
    elsewhere = pose((-0.1, 0.2, 0.7), (-0.2, 0.1, 0.3))
    generation = tracker.track(generation, see(elsewhere), frame=32)
    assert generation.is_tracking and is_right(generation, elsewhere)


def test_an_image_of_before_is_not_taken_for_one_of_now(tracker):
    generation = tracker.start_population(see(moving(0)))
    hand = np.array([0.02, 0.0, 0.0])
    stale = see(ASKEW)
    generation = tracker.start_population(stale)
    carried = generation.carried(np.eye(3), -hand)
    generation = tracker.track(carried, stale, frame=1)
    assert generation.state == TrackingState.PREDICTED
    np.testing.assert_allclose(generation.best[:3], ASKEW[:3] - hand, atol=0.002)
    # Where nothing should have moved, it may well be one of now.
    again = tracker.track(tracker.start_population(stale), stale, frame=1)
    assert again.state == TrackingState.TRACKING


def test_a_pose_far_from_where_it_should_be_is_doubted_once(tracker, found):
    generation = found
    for k in range(1, 10):
        generation = tracker.track(generation, see(ASKEW + 1e-5 * k), frame=k)
    jumped = pose(ASKEW[:3] + [0.02, 0.0, 0.0], ASKEW[3:])
    doubted = tracker.track(generation, see(jumped), frame=10)
    assert is_right(doubted, jumped) and doubted.confidence < 0.6 * generation.confidence
    back = tracker.track(doubted, see(ASKEW), frame=11)
    assert is_right(back, ASKEW) and back.is_tracking
    stays = tracker.track(doubted, see(jumped + 3e-4), frame=11)
    assert is_right(stays, jumped) and stays.is_tracking


# Bad input


def test_without_a_border_refiner_it_is_refused():
    with pytest.raises(TypeError, match="refiner must be a BorderRefiner, not a NoRefinement"):
        RobustTracker(ga=OneStepGaTracker(matcher=Matcher(SearchModel(BOX), RIG)))


def test_a_population_of_another_size_is_refused(tracker, found):
    with pytest.raises(ValueError, match=r"poses must have shape \(60, 6\), not \(3, 6\)"):
        tracker.track(dc.replace(found, poses=found.poses[:3]), see(ASKEW), frame=1)


def test_poses_carried_along_are_those_of_the_filter_too(found):
    R, p = np.eye(3), np.array([0.1, 0.0, 0.0])
    carried = found.carried(R, p)
    np.testing.assert_allclose(carried.poses, transport_pose(found.poses, R, p))
    np.testing.assert_allclose(carried.motion.pose, found.motion.pose + [0.1, 0, 0, 0, 0, 0])
