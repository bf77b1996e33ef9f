"""Where a target is in the world and how it moves, from what a recognizer sees of it."""

from __future__ import annotations

import dataclasses as dc
import math
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from mffdrake.recognition.parameters import Count, Finite, NonNegative, Positive, Share, parameters
from mffdrake.recognition.poses.pose import pose_from_transform, skew, transform_from_pose
from mffdrake.recognition.poses.pose_filter import (
    NUM_NUMBERS,
    PoseFilter,
    PoseFilterParameters,
    body_covariance,
    pose_covariance,
)
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.estimates import CovarianceFromVector

__all__ = ["EstimatorParameters", "TargetMotionEstimator"]

Array = NDArray[np.float64]


@parameters
class EstimatorParameters:
    """How a target may move, and how much a pose says of it.

    Attributes:
        motion: How it may move, as far as refined poses tell.
        unrefined_motion: The same for poses that are not refined: calmer, and always so, lest their
            errors pass for motion.
        lateral_error: Standard error of a pose that is not refined across the line of sight [m],
            times 1 - fitness;
        depth_error: ... and along it [m], times that;
        rotation_error: ... and of its rotation vector along each axis [rad], times that. All three
            were measured on runs of the 1-step GA (box, 0.8 m).
        least_unfit: 1 - fitness counts as that at least.
        unrefined_factor: So many times that variance such an error counts as: it stays for some
            frames.
        refined_factor: The same for a refined pose and its own covariance.
        systematic: Share of a refined pose's own covariance that is the same in frame after frame,
            as long as the target is seen from the same side: no mean lessens it.
        gate: Poses of a greater normalized innovation squared (`PoseFilter.nis`) are left out, ...
        patience: ... but so many in a row are believed.
        lost_error: From this standard error of the predicted place on, the target is lost [m].

    Example:
        >>> EstimatorParameters(gate=30.0).patience
        2
    """

    motion: PoseFilterParameters = dc.field(
        default_factory=lambda: PoseFilterParameters(
            acceleration=0.2,
            angular_acceleration=0.2,
            lasting=10.0,
            swing=4.0,
            speed=0.1,
            angular_speed=0.3,
            adaptive=True,
        )
    )
    unrefined_motion: PoseFilterParameters = dc.field(
        default_factory=lambda: PoseFilterParameters(
            acceleration=0.03, angular_acceleration=0.03, speed=0.1, angular_speed=0.3
        )
    )
    lateral_error: Positive = 0.016
    depth_error: Positive = 0.1
    rotation_error: Positive = 0.11
    least_unfit: Share = 0.03
    unrefined_factor: Positive = 40.0
    refined_factor: Positive = 1.5
    systematic: NonNegative = 0.15
    gate: Annotated[Finite, Ge(1), Le(1e9)] = 25.0
    patience: Count = 2
    lost_error: Positive = 0.2


class _Measurement(NamedTuple):
    """A recognized pose.

    Attributes:
        pose: Pose vector in the world, shape (6,).
        covariance: Of its error, as a pose vector's, shape (6, 6).
        systematic: That of the error's systematic part, seen from the target, shape (6, 6).
        is_refined: Whether the recognizer itself told the covariance.
    """

    pose: Array
    covariance: Array
    systematic: Array
    is_refined: bool


class TargetMotionEstimator(LeafSystem):
    """Estimates a target's pose and velocity in the world: a Kalman filter on recognized poses.

    .. pydrake_system::

        name: TargetMotionEstimator
        input_ports:
        - pose
        - fitness
        - pose_covariance
        - frame_time
        - is_tracking
        - X_WM
        output_ports:
        - X_WM
        - target_velocity
        - covariance
        - is_known

    One control tick after each frame it takes the recognizer's result, where that is to be relied
    on, as of the time at which the images were exposed. Its outputs are predictions from there to
    the present time, as the target moves by the last frames: by refined poses, with an acceleration
    that lasts and at the frequency at which it has been seen to swing, else at constant velocity
    (see `PoseFilter`). So it bridges latencies, dropped frames and occlusions, with growing
    covariance.

    It forms everything in the world: there, the hand's own motion is no motion of the target, while
    in the camera an oscillating hand would be one.

    Ports:
        pose, fitness, pose_covariance, frame_time, is_tracking, X_WM: The recognizer's outputs of
            these names. Where the covariance is NaN, `EstimatorParameters` tell it of the fitness.
        X_WM: The target's estimated pose at the present time, as a RigidTransform; the world's own
            before the first pose that is to be relied on.
        target_velocity: Its linear [m/s] and angular velocity [rad/s] in the world,
            ``(v_WM, w_WM)``, shape (6,); zero before that.
        covariance: Of the errors of position [m], orientation (a rotation vector) [rad], linear
            [m/s] and angular velocity [rad/s], all along the world's axes, 12 x 12 row by row,
            shape (144,); NaN before that.
        is_known: 1 where the target's place is known well enough, else 0, shape (1,).

    Args:
        parameters: How the target may move, and how much a pose says of it.
        latency: Known age of the images at their frame's time [s].
        timing: Control and vision periods: those of the recognizer.

    Example:
        >>> estimator = TargetMotionEstimator()
        >>> context = estimator.CreateDefaultContext()
        >>> X_WM = RigidTransform([1.7, 0.0, 0.4])
        >>> for name, value in (("pose", [0, 0, 0.8, 0, 0, 0]), ("fitness", [0.9]),
        ...                     ("frame_time", [0.0]),
        ...                     ("pose_covariance", 1e-8 * np.eye(6).ravel()), ("is_tracking", [1]),
        ...                     ("X_WM", AbstractValue.Make(X_WM))):
        ...     _ = estimator.GetInputPort(name).FixValue(context, value)
        >>> estimator.CalcForcedDiscreteVariableUpdate(
        ...     context, context.get_mutable_discrete_state())
        >>> estimator.GetOutputPort("X_WM").Eval(context).translation()
        array([1.7, 0. , 0.4])
    """

    def __init__(
        self,
        *,
        parameters: EstimatorParameters | None = None,
        latency: float = 0.0,
        timing: Timing | None = None,
    ) -> None:
        super().__init__()
        self._parameters = EstimatorParameters() if parameters is None else parameters
        self._latency = latency
        self._timing = Timing() if timing is None else timing
        self._timing.CheckLatency(latency)

        pose = AbstractValue.Make(RigidTransform())
        self._pose = self.DeclareVectorInputPort("pose", 6)
        self._fitness = self.DeclareVectorInputPort("fitness", 1)
        self._pose_covariance = self.DeclareVectorInputPort("pose_covariance", 36)
        self._frame_time = self.DeclareVectorInputPort("frame_time", 1)
        self._is_tracking = self.DeclareVectorInputPort("is_tracking", 1)
        self._seen = self.DeclareAbstractInputPort("X_WM", pose)

        self._filter = self.DeclareDiscreteState(np.full(NUM_NUMBERS, math.nan))
        # The filter's time, that of the last frame that it was told of [s], outliers in a row, and
        # whether that frame's pose was refined
        self._history = self.DeclareDiscreteState([math.nan, math.nan, 0.0, 1.0])
        # Covariance of the systematic error of its pose, seen from the target
        self._systematic = self.DeclareDiscreteState(36)

        # What is known by now, once for all ports: a list of a filter, or of None
        self._present = self.DeclareCacheEntry(
            "present",
            ValueProducer(
                allocate=lambda: AbstractValue.Make([None]), calc=WeakCallback(self._CalcPresent)
            ),
            {self.time_ticket(), self.xd_ticket()},
        )
        from_filter = {self.cache_entry_ticket(self._present.cache_index())}
        self.DeclareAbstractOutputPort(
            "X_WM",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcPose),
            from_filter,
        )
        for name, size, calc in (
            ("target_velocity", 6, self._CalcVelocity),
            ("covariance", 144, self._CalcCovariance),
            ("is_known", 1, self._CalcIsKnown),
        ):
            self.DeclareVectorOutputPort(name, size, WeakCallback(calc), from_filter)

        self.DeclarePeriodicDiscreteUpdateEvent(
            self._timing.control_period, 0.0, self._UpdateAfterFrame
        )
        self.DeclareForcedDiscreteUpdateEvent(self._Update)

    @property
    def timing(self) -> Timing:
        """Control and vision periods."""
        return self._timing

    def _UpdateAfterFrame(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._timing.IsVisionTick(context.get_time(), delay_ticks=-1):
            self._Update(context, discrete_state)

    def _Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        p = self._parameters
        filter_time, last_frame, outliers, _ = context.get_discrete_state(self._history).value()
        (frame_time,) = self._frame_time.Eval(context)
        is_new = not math.isnan(frame_time) and frame_time != last_frame
        seen, C, systematic, is_refined = self._Measure(context)
        if not is_new or self._is_tracking.Eval(context)[0] != 1.0:
            return
        exposed = frame_time - self._latency
        motion = p.motion if is_refined else p.unrefined_motion
        known = self._Filter(context)
        if known is None or outliers >= p.patience:
            known, outliers = PoseFilter.of(seen, C, motion), 0
        else:
            predicted = known.predict(max(0.0, exposed - filter_time), motion)
            updated = predicted.update(seen, C)
            if updated.nis <= p.gate:
                known, outliers = updated, 0
            else:
                known, outliers = predicted.reject(seen, C), outliers + 1
        discrete_state.set_value(self._filter, known.numbers(np.zeros(6)))
        discrete_state.set_value(self._history, [exposed, frame_time, outliers, float(is_refined)])
        discrete_state.set_value(self._systematic, systematic.reshape(-1))

    def _Measure(self, context: Context) -> _Measurement:
        """The recognized pose in the world."""
        p, pose = self._parameters, self._pose.Eval(context)
        unfit = max(p.least_unfit, 1.0 - self._fitness.Eval(context)[0])
        C = CovarianceFromVector(self._pose_covariance.Eval(context))
        systematic = np.zeros((6, 6))
        if C is None:
            R, r = transform_from_pose(pose)
            sight = r / max(1e-9, float(np.linalg.norm(r)))
            variance = p.unrefined_factor * unfit**2
            place = p.lateral_error**2 * (np.eye(3) - np.outer(sight, sight))
            place += p.depth_error**2 * np.outer(sight, sight)
            body = np.zeros((6, 6))
            body[:3, :3] = variance * (R.T @ place @ R)
            body[3:, 3:] = variance * p.rotation_error**2 * np.eye(3)
        else:
            told = body_covariance(pose, C)
            body, systematic = p.refined_factor * told, p.systematic * told
        X_WM = self._seen.Eval(context)
        seen = pose_from_transform(X_WM.rotation().matrix(), X_WM.translation())
        return _Measurement(seen, pose_covariance(seen, body), systematic, C is not None)

    def _Filter(self, context: Context) -> PoseFilter | None:
        numbers = context.get_discrete_state(self._filter).value()
        return None if math.isnan(numbers[0]) else PoseFilter.of_numbers(np.zeros(6), numbers)

    def _CalcPresent(self, context: Context, value: AbstractValue) -> None:
        known = self._Filter(context)
        if known is not None:
            p = self._parameters
            filter_time, _, _, is_refined = context.get_discrete_state(self._history).value()
            motion = p.motion if is_refined else p.unrefined_motion
            known = known.predict(max(0.0, context.get_time() - filter_time), motion)
        value.set_value([known])

    def _Present(self, context: Context) -> PoseFilter | None:
        """What is known by now."""
        (known,) = self._present.Eval(context)
        return known  # type: ignore[no-any-return]

    def _CalcPose(self, context: Context, output: AbstractValue) -> None:
        known = self._Present(context)
        if known is None:
            output.set_value(RigidTransform())
            return
        R, p = transform_from_pose(known.pose)
        output.set_value(RigidTransform(RotationMatrix.ProjectToRotationMatrix(R), p))

    def _CalcVelocity(self, context: Context, output: BasicVector) -> None:
        known = self._Present(context)
        output.SetFromVector(np.zeros(6) if known is None else known.velocity)

    def _CalcCovariance(self, context: Context, output: BasicVector) -> None:
        known = self._Present(context)
        covariance = np.full((12, 12), math.nan)
        if known is not None:
            # The filter's errors are seen from the target; its orientation's turn its velocity.
            R, G = transform_from_pose(known.pose)[0], np.zeros((12, 12))
            for k in range(4):
                G[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = R
            G[6:9, 3:6] = -R @ skew(known.twist[:3])
            G[9:, 3:6] = -R @ skew(known.twist[3:])
            P = known.covariance[:12, :12].copy()
            P[:6, :6] += context.get_discrete_state(self._systematic).value().reshape(6, 6)
            covariance = G @ P @ G.T
        output.SetFromVector(covariance.reshape(-1))

    def _CalcIsKnown(self, context: Context, output: BasicVector) -> None:
        known = self._Present(context)
        error = math.inf
        if known is not None:
            error = math.sqrt(max(0.0, float(np.trace(known.covariance[:3, :3]))))
        output.SetFromVector([float(error <= self._parameters.lost_error)])
