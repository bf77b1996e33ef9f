"""Poses and joints of any numbers: a fitness from 0 to 1, a pose or one clear line, never NaN
that came of numbers."""

import functools

import numpy as np
from hypothesis import example
from hypothesis import strategies as st
from judging import HEIGHT, NUMBERS, WIDTH, box, check_message, matcher, outcome, prop, vectors

import mffdrake as mff

POSE = st.one_of(
    vectors(6),
    st.tuples(vectors(3, st.floats(-1.0, 1.0)), vectors(3)).map(np.concatenate),
    st.tuples(vectors(3), vectors(3, st.floats(-1.0, 1.0))).map(np.concatenate),
    st.tuples(vectors(3, st.floats(-1.0, 1.0)), vectors(3, st.floats(-1.0, 1.0))).map(
        np.concatenate
    ),
    vectors(6, st.floats(-0.4, 0.4)).map(lambda pose: pose + [0, 0, 0.8, 0, 0, 0]),
)
POSES = st.lists(POSE, min_size=1, max_size=5).map(np.array)


@functools.cache
def images():
    """The box, roughly, on grey."""
    pair = np.full((2, HEIGHT, WIDTH, 3), 128, dtype=np.uint8)
    pair[:, 16:32, 27:38] = (0, 0, 255)
    pair[:, 16:32, 38:42] = (255, 0, 0)
    return tuple(pair)


def check_fitness(fitness):
    assert ((np.asarray(fitness) >= 0.0) & (np.asarray(fitness) <= 1.0)).all(), fitness


@prop(POSES)
def test_any_poses_have_a_fitness(poses):
    fitness = matcher().fitness(poses, images())
    assert fitness.shape == (len(poses),)
    check_fitness(fitness)
    assert (fitness[~np.isfinite(poses).all(axis=1)] == 0.0).all()
    alone = [matcher().fitness(pose, images())[0] for pose in poses]
    assert np.array_equal(fitness, alone)  # None depends on its neighbors.
    shown = matcher().middle_shown(poses, matcher().scene(images()))
    assert ((shown >= 0) & (shown <= 2)).all()


@prop(st.one_of(st.lists(st.lists(NUMBERS, max_size=8), max_size=3), st.text(), st.none()))
def test_what_is_no_pose_is_told(poses):
    def fitness():
        try:
            return matcher().fitness(poses, images())
        except TypeError as error:
            check_message(str(error))

    fitness = outcome(fitness, error=ValueError)
    assert fitness is None or np.isfinite(fitness).all()


@example(np.array([1.7e308, 0.0, 0.0, 0.0, 0.0, 0.0]))
@prop(POSE)
def test_any_pose_is_refined_or_given_back(pose):
    result = mff.BorderRefiner(matcher()).refine(pose, images())
    if result.converged:
        assert np.isfinite(result.pose).all() and np.isfinite(result.covariance).all()
        check_fitness(result.fitness)
    else:
        assert np.array_equal(result.pose, pose, equal_nan=True)
        check_message(result.reason)


@prop(POSES, vectors(3), vectors(3))
def test_transport_keeps_numbers_numbers_and_rows_apart(poses, turn, shift):
    eps = turn / max(1.0, np.linalg.norm(turn)) if np.abs(turn).max() < 1e100 else np.zeros(3)
    R = mff.transform_from_pose(np.concatenate([np.zeros(3), eps]))[0]
    if not np.isfinite(R).all():
        return
    with np.errstate(all="ignore"):
        moved = mff.transport_pose(poses, R, shift)
        alone = np.array([mff.transport_pose(pose, R, shift) for pose in poses])
    assert np.array_equal(moved, alone, equal_nan=True)
    sane = (np.abs(poses) < 1e100).all(axis=1) & (np.abs(shift) < 1e100).all()
    assert np.isfinite(moved[sane]).all()
    unit = sane & (np.linalg.norm(np.where(sane[:, None], poses, 0)[:, 3:], axis=1) <= 1.0)
    assert (np.linalg.norm(moved[unit, 3:], axis=1) <= 1.0 + 1e-6).all()


def tracker(refine):
    return mff.PoseTracker.of(
        matcher().rig, box(), channel_order="rgb", refine=refine,
    )  # fmt: skip


@prop(POSE, st.tuples(NUMBERS, NUMBERS), st.booleans(), share=0.3)
def test_a_tracker_starts_at_any_pose_or_tells(pose, spread, refine):
    tracks = tracker(refine)
    estimate = outcome(tracks.start, images(), pose, spread=spread, error=ValueError)
    if estimate is not None:
        check_fitness(estimate.fitness)
        check_fitness(tracks.track(images()).fitness)


@prop(st.one_of(vectors(12), st.lists(NUMBERS, max_size=16)), st.booleans(), share=0.3)
def test_a_tracker_takes_any_motion_or_tells(numbers, refine):
    tracks = tracker(refine)
    tracks.start(images())
    X_DC = np.reshape(numbers, (3, 4)) if len(numbers) == 12 else numbers
    with np.errstate(all="ignore"):
        estimate = outcome(tracks.track, images(), X_DC, error=ValueError)
        if estimate is not None:
            check_fitness(estimate.fitness)
        estimate = tracks.track(images())
    check_fitness(estimate.fitness)
    assert np.isfinite(estimate.pose).all()
