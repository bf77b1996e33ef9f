"""Evidence of poses, right and wrong ones: the confidence is fitted to it and checked with it."""

from __future__ import annotations

import math
from typing import NamedTuple
from unittest import mock

import numpy as np
from acquisition.cases import SOLIDS, Case, Renderer, disturb
from acquisition.study import errors, make_tracker, show
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.evaluation import IsRight
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.poses.pose import compose_quaternion_vectors
from mffdrake.recognition.poses.pose_filter import body_covariance
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.recognition.poses.tracking_state import TrackingState
from mffdrake.recognition.solid.symmetry import find_symmetries
from mffdrake.recognition.tracking import robust_tracker
from mffdrake.recognition.tracking.confidence import (
    RIGHT_POSITION,
    RIGHT_ROTATION,
    WEIGHTS,
    Evidence,
    confidence,
    features,
)

Array = NDArray[np.float64]

STARTS = 40  # for wrong optima, a pose
SHIFT = 0.03  # [m], their standard deviation from the true pose


class Judged(NamedTuple):
    """Frames with the state TRACKING: their features, whether they are right; and of how many."""

    rows: Array
    right: NDArray[np.bool_]
    total: int


def of_run(scenario: Scenario) -> Judged:
    """The frames of a run."""
    judged: list[Evidence | None] = []
    with mock.patch.object(robust_tracker, "confidence", wraps=confidence) as judge:

        def on_frame(time: float, wall_s: float) -> None:
            judged.append(judge.call_args.args[0] if judge.called else None)
            judge.reset_mock()

        result = Simulate(scenario, on_frame=on_frame)
    counts = np.flatnonzero(result.state == TrackingState.TRACKING)
    rows = np.empty((len(counts), len(WEIGHTS)))
    for row, k in zip(rows, counts, strict=True):
        evidence = judged[k]
        # A pose where it was not expected is doubted once, on top of that.
        if evidence is None or confidence(evidence) < result.confidence[k]:
            raise RuntimeError(f"frame {k}: {evidence} is not what it was judged by")
        row[:] = features(evidence)
    return Judged(rows, IsRight(result)[counts], len(result.time))


def of_starts(case: Case, renderer: str, seed: int, poses: range) -> Judged:
    """The first frames of a tracker that is shown poses of a case of the acquisition study."""
    rows, right, total = [], [], 0
    with mock.patch.object(robust_tracker, "confidence", wraps=confidence) as judge:
        for frame in show(case, renderer, None, seed, poses):
            if judge.called and frame.generation.state == TrackingState.TRACKING:
                rows.append(features(judge.call_args.args[0]))
                right.append(frame.position <= RIGHT_POSITION and frame.rotation <= RIGHT_ROTATION)
            judge.reset_mock()
            total += 1
    return Judged(np.array(rows).reshape(-1, len(WEIGHTS)), np.array(right, dtype=bool), total)


def of_wrong_optima(case: Case, renderer: str, seed: int, poses: range) -> Judged:
    """Poses that explain their borders and are wrong: where steps lead to from beside the truth.

    Those that `Detector.resolve` would turn into others, or calls ambiguous, do not count.
    """
    draw, solid, rows = Renderer(case, renderer), SOLIDS[case.solid], []
    symmetries = find_symmetries(solid)
    tracker = make_tracker(case)
    for n in poses:
        rng = np.random.default_rng([seed, n])
        true = case.draw_pose(rng)
        scene = tracker.matcher.scene(disturb(draw(true), case, [seed, n], 0))
        for k in range(STARTS):
            axis, angle = rng.normal(size=3), rng.uniform(0.0, math.pi if k % 2 else 0.7)
            turn = rotate_by(angle * axis / np.linalg.norm(axis))
            eps = compose_quaternion_vectors(turn, true[3:])
            start = np.concatenate([true[:3] + rng.normal(0.0, SHIFT, 3), eps])
            seen = tracker.detector.near(start, start, scene)
            if seen is None:
                continue
            apart, turned = errors(seen.pose, true, symmetries)
            right = apart <= RIGHT_POSITION and turned <= RIGHT_ROTATION
            resolved = tracker.detector.resolve(seen, scene)
            if not (right or resolved.ambiguous or resolved.refined is not seen.refined):
                C = body_covariance(seen.pose, seen.refined.covariance)
                rows.append(features(Evidence.of(seen.refined, C, seen.explained, 0.0)))
    found = np.array(rows).reshape(-1, len(WEIGHTS))
    return Judged(found, np.zeros(len(found), dtype=bool), len(found))
