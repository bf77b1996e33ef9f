"""Motion feedforward: carries pose hypotheses along with the hand."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from mffdrake.recognition.poses.pose_motion import (
    camera_motion_jacobian,
    move_target,
    step_pose,
    target_motion_jacobian,
    transport_pose,
)
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.finite import EvalFinite
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.exposures import Exposures

__all__ = ["MffPredictor"]

Array = NDArray[np.float64]


class MffPredictor(LeafSystem):
    """Predicts how the target's pose in the camera changed since the last frame.

    .. pydrake_system::

        name: MffPredictor
        input_ports:
        - estimated_state
        - population
        - target_velocity (optional)
        - frame_time (optional)
        output_ports:
        - predicted_population
        - camera_displacement
        - X_WC
        - pose_rate

    Between two frames the hand moves, so every hypothesis of the last frame is stale. The joints
    tell by how much: this is the motion feedforward (MFF). It serves any tracker: with
    ``num_hypotheses=1`` it predicts a single pose.

    Two modes:

    - ``rigid`` (exact): the camera's displacement from the joint positions at both frames.
    - ``velocity``, Eq. (12): the pose's rate (10) at the last frame, from the joints' velocities,
      times the time between the frames. It errs in the second order of that time.

    The joints are sampled at every frame's exposure and kept in discrete state. A forced discrete
    update takes a sample at once, whatever the time. Until two exposures are known, the prediction
    is that nothing moved.

    Connect ``target_velocity`` where the target moves. With one that follows the hand, as in
    servoing, the camera's motion alone is worse than no feedforward: it erred by 41 to 64 mm, and
    by 0.8 mm with the target's velocity.

    `ConnectFeedforward` connects a predictor with its recognizer.

    Ports:
        estimated_state: Joint positions and velocities of ``plant``.
        population: N pose vectors ``(r [m], eps)`` in the right camera's frame C at the last frame,
            shape (6 N,).
        target_velocity: The target's own linear [m/s] and angular velocity [rad/s] in the world,
            ``(v_WM, w_WM)`` in the pose vector's order, shape (6,). Zero where not connected.
        frame_time: Time of the tracker's last frame [s], NaN before the first; the recognizer's
            port of that name. Where it is connected, a prediction from another frame is an error.
        predicted_population: The same hypotheses in the present frame, shape (6 N,).
        camera_displacement: X_DC as a RigidTransform: the last frame's camera C in the present
            frame's camera D.
        X_WC: The camera's pose in the world at the present frame's exposure, as a RigidTransform;
            at the present time until two exposures are known.
        pose_rate: Eq. (10) for the first hypothesis with the present joints [m/s, 1/s], shape (6,).

    Args:
        plant: The arm, finalized, with as many states as ``estimated_state``.
        camera_frame: Name of the right camera's frame C in ``plant``.
        num_hypotheses: Number N of hypotheses.
        mode: ``"rigid"`` or ``"velocity"``.
        latency: Known delay of the camera [s], a whole multiple of the control period: the images
            at time t show the scene at t - latency.
        gain: Share of the predicted motion that is applied; 1 is right, 0 is no feedforward.
        timing: Control and vision periods: those of the recognizer, or the prediction is for
            another time than its frame's.

    Raises:
        ValueError: When an argument is outside its range.
        RuntimeError: At a prediction, when ``frame_time`` is not the time of this system's last
            frame; when the arm's state, a hypothesis or the target's velocity is not finite.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant, NOMINAL_POSITIONS
        >>> predictor = MffPredictor(plant=MakePa10Plant(), num_hypotheses=1)
        >>> context = predictor.CreateDefaultContext()
        >>> state = predictor.GetInputPort("estimated_state")
        >>> _ = predictor.GetInputPort("population").FixValue(context, [0, 0.155, 0.8, 0, 0, 0])
        >>> _ = state.FixValue(context, np.append(NOMINAL_POSITIONS, np.zeros(7)))
        >>> predictor.CalcForcedDiscreteVariableUpdate(
        ...     context, context.get_mutable_discrete_state())
        >>> turned = NOMINAL_POSITIONS + np.array([0.01, 0, 0, 0, 0, 0, 0])   # base to the left
        >>> _ = state.FixValue(context, np.append(turned, np.zeros(7)))
        >>> predictor.GetOutputPort("predicted_population").Eval(context)[:3].round(4)
        array([0.0172, 0.155 , 0.7999])
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        camera_frame: str = "camera_right",
        num_hypotheses: int = 60,
        mode: Literal["rigid", "velocity"] = "rigid",
        latency: float = 0.0,
        gain: float = 1.0,
        timing: Timing | None = None,
    ) -> None:
        super().__init__()
        self._timing = Timing() if timing is None else timing
        self._CheckArguments(num_hypotheses, mode, gain)
        self._predict = {"rigid": self._PredictRigid, "velocity": self._PredictVelocity}[mode]
        self._gain = gain
        self._plant = plant
        self._frame = plant.GetFrameByName(camera_frame)
        # Scratch space for kinematics, written before every use: it carries no state.
        self._kinematics = plant.CreateDefaultContext()

        # The images of this frame were exposed `latency` ago, in general not at a frame's time.
        self._latency = latency
        self._exposures = Exposures(self._timing, latency)

        size = plant.num_multibody_states()
        self._state = self.DeclareVectorInputPort("estimated_state", size)
        self._population = self.DeclareVectorInputPort("population", 6 * num_hypotheses)
        self._velocity = self.DeclareVectorInputPort("target_velocity", 6)
        self._frame_time = self.DeclareVectorInputPort("frame_time", 1)
        # Rows of a time and the arm's state then.
        self._samples = self.DeclareDiscreteState(
            np.full(self._exposures.num_samples * (1 + size), math.nan)
        )

        # What several outputs need of a frame is computed once. (The entry itself, kept here, would
        # keep this system alive for ever.)
        self._exposed = self.DeclareCacheEntry(
            "exposed",
            ValueProducer(lambda: Value[object](), WeakCallback(self._CalcExposed)),
            {
                self.time_ticket(),
                self._state.ticket(),
                self.discrete_state_ticket(self._samples),
            },
        ).cache_index()
        from_exposed = {self.cache_entry_ticket(self._exposed)}
        self.DeclareVectorOutputPort(
            "predicted_population", 6 * num_hypotheses, WeakCallback(self._CalcPredictedPopulation)
        )
        self.DeclareAbstractOutputPort(
            "camera_displacement",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcCameraDisplacement),
            from_exposed,
        )
        self.DeclareAbstractOutputPort(
            "X_WC",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcCameraPose),
            from_exposed,
        )
        self.DeclareVectorOutputPort("pose_rate", 6, WeakCallback(self._CalcPoseRate))

        self.DeclarePeriodicDiscreteUpdateEvent(
            self._exposures.event_period, 0.0, self._SampleOnExposure
        )
        self.DeclareForcedDiscreteUpdateEvent(self._Sample)

    @property
    def timing(self) -> Timing:
        """Control and vision periods."""
        return self._timing

    def _CheckArguments(self, num_hypotheses: int, mode: str, gain: float) -> None:
        if num_hypotheses < 1:
            raise ValueError(f"num_hypotheses must be at least 1, not {num_hypotheses}")
        if mode not in ("rigid", "velocity"):
            raise ValueError(f"mode must be 'rigid' or 'velocity', not {mode!r}")
        if not math.isfinite(gain):
            raise ValueError(f"gain must be a finite number, not {gain}")

    def _SampleOnExposure(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._exposures.IsExposure(context.get_time()):
            self._Sample(context, discrete_state)

    def _Sample(self, context: Context, discrete_state: DiscreteValues) -> None:
        newest = np.append(context.get_time(), EvalFinite(self, self._state, context))
        older = context.get_discrete_state(self._samples).value()[: -len(newest)]
        discrete_state.set_value(self._samples, np.append(newest, older))

    def _EvalExposed(self, context: Context) -> _Exposed:
        exposed: _Exposed = self.get_cache_entry(self._exposed).Eval(context)
        return exposed

    def _CalcExposed(self, context: Context, output: AbstractValue) -> None:
        now = EvalFinite(self, self._state, context)
        # A copy: a view would keep the context, in which it is kept, alive for ever.
        rows = context.get_discrete_state(self._samples).value().copy().reshape(-1, 1 + len(now))
        last, present = self._exposures.Rows(context.get_time(), rows=rows, now=now)
        known = not math.isnan(last[0])
        X_WD = self._CameraPose(now if math.isnan(present[0]) else present[1:])
        X_WC, X_DC = X_WD, RigidTransform()
        if known:
            X_WC = self._CameraPose(last[1:])
            X_DC = X_WD.InvertAndCompose(X_WC)
        output.set_value(_Exposed(last, present, known, X_WC, X_WD, X_DC))

    def _CheckFrameTime(self, context: Context, last: float, present: float) -> None:
        """Compares the tracker's last frame with the times of two exposures."""
        if not self._frame_time.HasValue(context):
            return
        (frame_time,) = self._frame_time.Eval(context)
        # At a frame it is the last one's time. Between two frames the tracker has seen the present
        # one already, and this is what a logger then finds.
        half = 0.5 * self._timing.control_period
        # Comparisons are false for NaN: no frame yet.
        if all(abs(time + self._latency - frame_time) > half for time in (last, present)):
            raise RuntimeError(
                f"{self.get_name() or type(self).__name__}: at {context.get_time():.6g} s the "
                f"tracker's last frame ('frame_time') was at {frame_time:.6g} s, but this system's "
                f"at {last + self._latency:.6g} s, with a frame every "
                f"{self._timing.vision_period:.6g} s; give both the same timing"
            )

    def _CameraPose(self, state: Array) -> RigidTransform:
        """X_WC for an arm state."""
        self._plant.SetPositions(self._kinematics, state[: self._plant.num_positions()])
        return self._frame.CalcPoseInWorld(self._kinematics)

    def _TargetVelocity(self, context: Context) -> Array:
        if self._velocity.HasValue(context):
            return EvalFinite(self, self._velocity, context)
        return np.zeros(6)

    def _PoseRate(self, state: Array, poses: Array, target_velocity: Array) -> Array:
        """Eq. (10) at an arm state, for every pose."""
        R_WC = self._CameraPose(state).rotation().matrix()
        world = self._plant.world_frame()
        J = self._plant.CalcJacobianSpatialVelocity(
            self._kinematics, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )
        J_O, J_P = J[:3], J[3:]  # Eq. (8), (7); Drake puts the rotation first
        J_M = camera_motion_jacobian(R_WC, J_P, J_O, poses)
        J_N = target_motion_jacobian(R_WC, poses)
        velocities = state[self._plant.num_positions() :]
        return J_M @ velocities + J_N @ target_velocity  # Eq. (11) where the target is at rest

    def _PredictRigid(self, exposed: _Exposed, poses: Array, velocity: Array, dt: float) -> Array:
        """Eq. (12) exactly: rigid transport; the target's own displacement in between."""
        X_DC = _Scale(exposed.X_DC, self._gain)  # Eq. (14), for C and for D
        if velocity.any():  # seldom: the target is at rest, as a rule
            R_WC = exposed.X_WC.rotation().matrix()
            poses = move_target(poses, R_WC, velocity[:3], velocity[3:], self._gain * dt)
        return transport_pose(poses, X_DC.rotation().matrix(), X_DC.translation())

    def _PredictVelocity(
        self, exposed: _Exposed, poses: Array, velocity: Array, dt: float
    ) -> Array:
        """Eq. (12), (23), from the last frame's joints only."""
        return step_pose(poses, self._PoseRate(exposed.last[1:], poses, velocity), self._gain * dt)

    def _CalcPredictedPopulation(self, context: Context, output: BasicVector) -> None:
        population = EvalFinite(self, self._population, context)
        exposed = self._EvalExposed(context)
        if not exposed.known:
            output.SetFromVector(population)
            return
        self._CheckFrameTime(context, exposed.last[0], exposed.present[0])
        predicted = self._predict(
            exposed,
            population.reshape(-1, 6),
            self._TargetVelocity(context),
            self._timing.TimeBefore(self._exposures.NextFrame(context.get_time())),
        )
        output.SetFromVector(predicted.reshape(-1))

    def _CalcCameraDisplacement(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._EvalExposed(context).X_DC)

    def _CalcCameraPose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._EvalExposed(context).X_WD)

    def _CalcPoseRate(self, context: Context, output: BasicVector) -> None:
        first = EvalFinite(self, self._population, context)[:6]
        velocity = self._TargetVelocity(context)
        output.SetFromVector(
            self._PoseRate(EvalFinite(self, self._state, context), first, velocity)
        )


class _Exposed(NamedTuple):
    """Times and arm states at the last frame's exposure C and the present one's D, and the camera.

    Until two exposures are ``known``, nothing moved.
    """

    last: Array
    present: Array
    known: bool
    X_WC: RigidTransform
    X_WD: RigidTransform
    X_DC: RigidTransform


def _Scale(X: RigidTransform, gain: float) -> RigidTransform:
    """A share of a small displacement: its translation and its angle, each times the gain."""
    if gain == 1.0:
        return X
    turn = X.rotation().ToAngleAxis()
    scaled = AngleAxis(gain * turn.angle(), turn.axis())
    return RigidTransform(RotationMatrix(scaled), gain * X.translation())
