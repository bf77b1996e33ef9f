"""Leads the hand after a target: position-based visual servoing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from mffdrake.recognition.parameters import NonNegative, Period, Positive, parameters
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.finite import EvalFinite
from mffdrake.systems.timing import Timing

__all__ = ["ServoParameters", "VisualServoController"]

Array = NDArray[np.float64]


@parameters
class ServoParameters:
    """How the hand follows the target.

    Attributes:
        gain: The error's share that is taken back in a second [1/s].
        far_gain: The same where the error is large; null for the same gain everywhere. In between
            it changes over with ``exp(-error / far_error)``.
        far_error: That error [m, or rad].
        velocity_share: Share of the target's velocity that is fed forward; 1 is right.
        max_acceleration: Of every joint [rad/s^2].
        centering: Rate at which a redundant arm goes back to its nominal posture [1/s].
        period: Time between two joint velocities [s]; control ticks at least.

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> ServoParameters(gain=8.0).velocity_share
        1.0
    """

    gain: Positive = 3.0
    far_gain: Positive | None = None
    far_error: Positive = 0.02
    velocity_share: NonNegative = 1.0
    max_acceleration: Positive = 10.0
    centering: NonNegative = 0.5
    period: Period = 0.005

    def CalcGain(self, error: float) -> float:
        """The gain at an error [m or rad].

        Example:
            >>> ServoParameters(gain=8.0, far_gain=2.0).CalcGain(0.0)
            8.0
        """
        if self.far_gain is None:
            return self.gain
        return self.far_gain + (self.gain - self.far_gain) * math.exp(-error / self.far_error)


class VisualServoController(LeafSystem):
    """Moves an arm's reference so that a camera on its hand sees the target where it is wanted.

    .. pydrake_system::

        name: VisualServoController
        input_ports:
        - X_WM
        - target_velocity
        - is_known
        output_ports:
        - desired_state
        - desired_acceleration
        - is_stuck

    Where the target is at X_WM, the camera is wanted at ``X_WM X_CM*^-1``. The camera of the
    *reference* arm, which moves as it is told, goes there at the velocity with which the wanted
    pose moves, and a gain times what is missing. Both are formed in the world: what the true arm
    does about its reference is no motion of the target.

    Drake's differential inverse kinematics make joint velocities of that, within the joints'
    position and velocity limits, near the nominal posture where the arm is redundant. Their change
    is scaled down to the acceleration limit.

    While the target is not known, the reference slows down and holds; once it is known again, it
    goes on from there.

    Ports:
        X_WM: Target's pose in the world, as a RigidTransform.
        target_velocity: Its linear [m/s] and angular velocity [rad/s], ``(v_WM, w_WM)``, (6,).
        is_known: 1 where these are to be relied on, else 0, shape (1,).
        desired_state: Reference joint positions [rad] and velocities [rad/s], shape (2 n,).
        desired_acceleration: Their rates [rad/s^2], shape (n,).
        is_stuck: 1 where limits or a singular pose keep the arm from following, shape (1,).

    Args:
        plant: The arm, finalized, with n joints that all move.
        camera_frame: Name of the camera's frame C.
        X_CM: Where the camera is to see the target.
        start: Joint positions at the start [rad], shape (n,); also the nominal posture.
        parameters: How it follows.
        timing: Control and vision periods.

    Raises:
        ValueError: When ``start`` has another shape, or the period is less than the control's.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant, NOMINAL_POSITIONS
        >>> servo = VisualServoController(
        ...     plant=MakePa10Plant(), X_CM=RigidTransform([0, 0, 0.8]), start=NOMINAL_POSITIONS)
        >>> servo.GetOutputPort("desired_state").size()
        14
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        X_CM: RigidTransform,
        start: ArrayLike,
        camera_frame: str = "camera_right",
        parameters: ServoParameters | None = None,
        timing: Timing | None = None,
    ) -> None:
        super().__init__()
        self._parameters = p = ServoParameters() if parameters is None else parameters
        timing = Timing() if timing is None else timing
        if timing.IsShort(p.period):
            raise ValueError(
                f"VisualServoController: period must be at least the control period of "
                f"{timing.control_period} s, not {p.period} s"
            )
        self._n = n = plant.num_positions()
        start = np.array(start, dtype=float)
        if start.shape != (n,):
            raise ValueError(
                f"VisualServoController: start must have shape ({n},), not {start.shape}"
            )
        # A whole number of control ticks, lest the reference changes between two of them.
        self._period = timing.control_period * round(p.period / timing.control_period)
        self._plant, self._frame = plant, plant.GetFrameByName(camera_frame)
        # Scratch space for kinematics, written before every use: it carries no state.
        self._kinematics = plant.CreateDefaultContext()
        self._X_MC = X_CM.inverse()
        self._limits = _Limits(plant, start, self._period, p.centering)

        self._X_WM = self.DeclareAbstractInputPort("X_WM", AbstractValue.Make(RigidTransform()))
        self._velocity = self.DeclareVectorInputPort("target_velocity", 6)
        self._is_known = self.DeclareVectorInputPort("is_known", 1)

        # Positions, velocities and accelerations of the reference, its time, and whether it sticks
        self._reference = self.DeclareDiscreteState(
            np.concatenate([start, np.zeros(2 * n), [0.0, 0.0]])
        )
        from_reference = {self.time_ticket(), self.discrete_state_ticket(self._reference)}
        for name, size, calc in (
            ("desired_state", 2 * n, self._CalcDesiredState),
            ("desired_acceleration", n, self._CalcDesiredAcceleration),
            ("is_stuck", 1, self._CalcIsStuck),
        ):
            self.DeclareVectorOutputPort(name, size, WeakCallback(calc), from_reference)
        self.DeclarePeriodicDiscreteUpdateEvent(self._period, 0.0, self._Update)
        self.DeclareForcedDiscreteUpdateEvent(self._Update)

    def _Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        q, v = self._Reference(context)
        self._plant.SetPositions(self._kinematics, q)
        self._plant.SetVelocities(self._kinematics, v)
        is_known = EvalFinite(self, self._is_known, context)[0]  # exactly 0 or 1
        wanted = is_known * self._CalcCameraVelocity(context)
        result = DoDifferentialInverseKinematics(
            self._plant, self._kinematics, wanted, self._frame, self._limits
        )
        is_stuck = result.status != DifferentialInverseKinematicsStatus.kSolutionFound
        change = -v
        if result.joint_velocities is not None and not is_stuck:
            change = result.joint_velocities - v
        most = self._parameters.max_acceleration * self._period
        change *= min(1.0, most / max(1e-12, float(np.abs(change).max())))
        discrete_state.set_value(
            self._reference,
            np.concatenate(
                [q, v + change, change / self._period, [context.get_time(), float(is_stuck)]]
            ),
        )

    def _CalcCameraVelocity(self, context: Context) -> Array:
        """The reference camera's wanted angular [rad/s] and linear velocity [m/s], (6,)."""
        p = self._parameters
        X_WC = self._frame.CalcPoseInWorld(self._kinematics)
        X_WM, velocity = self._X_WM.Eval(context), EvalFinite(self, self._velocity, context)
        wanted = X_WM @ self._X_MC
        v_WM, w_WM = p.velocity_share * velocity[:3], p.velocity_share * velocity[3:]
        # The wanted pose is fixed to the target.
        arm = wanted.translation() - X_WM.translation()
        missing = wanted.translation() - X_WC.translation()
        turn = (wanted.rotation() @ X_WC.rotation().inverse()).ToAngleAxis()
        angular = w_WM + p.CalcGain(turn.angle()) * turn.angle() * turn.axis()
        linear = v_WM + np.cross(w_WM, arm)
        linear = linear + p.CalcGain(float(np.linalg.norm(missing))) * missing
        return np.concatenate([angular, linear])

    def _Reference(self, context: Context) -> tuple[Array, Array]:
        """Positions and velocities at the present time."""
        state = context.get_discrete_state(self._reference).value()
        q, v = state[: self._n], state[self._n : 2 * self._n]
        return q + (context.get_time() - state[-2]) * v, v.copy()

    def _CalcDesiredState(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate(self._Reference(context)))

    def _CalcDesiredAcceleration(self, context: Context, output: BasicVector) -> None:
        n = self._n
        output.SetFromVector(context.get_discrete_state(self._reference).value()[2 * n : 3 * n])

    def _CalcIsStuck(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._reference).value()[-1:])


def _Limits(
    plant: MultibodyPlant, nominal: Array, period: float, centering: float
) -> DifferentialInverseKinematicsParameters:
    """What Drake's differential inverse kinematics keep."""
    n = plant.num_positions()
    limits = DifferentialInverseKinematicsParameters(n, n)
    limits.set_time_step(period)
    limits.set_nominal_joint_position(nominal)
    limits.set_joint_centering_gain(centering * np.eye(n))
    limits.set_joint_position_limits(
        (plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
    )
    limits.set_joint_velocity_limits(
        (plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits())
    )
    return limits
