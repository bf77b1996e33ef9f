"""The hand's path around the target, equations (29)-(31), and the joint motion that follows it.

Frames, in Drake's monogram notation: W world, E hand, E0 the hand's first pose. The hand swings on
a circle about the target, in the x-z plane of E0, and keeps its line of sight (z) on the target.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.systems.pa10 import JOINT_NAMES, NOMINAL_POSITIONS, NUM_JOINTS

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.framework import DiagramBuilder

__all__ = ["AddHandPathSource", "HandPath", "SolveHandPath", "UnreachablePathError"]

_S1, _S3, _E1 = (JOINT_NAMES.index(name) for name in ("S1", "S3", "E1"))
_FREE = [i for i in range(NUM_JOINTS) if i != _S3]  # S3 resolves the redundancy: it stays at 0.

_MARGIN = 0.1  # [s] of trajectory after the end, so that a source has a value at the end's ulp.
_PHASE_STEP = 0.02  # [rad] of the path's phase omega t from knot to knot,
_MAX_STEP = 0.1  # but at most this time,
_MIN_STEP = 0.001  # Knots nearer than this [s] help nobody.
_CONVERGED = 1e-10  # Pose error of a solution [m, rad].
_MIDWAY_ERROR = 1e-6  # Largest pose error halfway between two knots [m, rad].
_POSITION_REMEDY = "Reduce the path's amplitude or distance, or move X_WE0."
_VELOCITY_REMEDY = "Reduce the path's omega or amplitude."


class UnreachablePathError(ValueError):
    """The arm cannot follow the path; the message says when, why and what to change."""


def _MakeX_WE0() -> RigidTransform:
    """The hand's first pose, Eq. (29): z ahead (+x of the world), x to the right, y down."""
    return RigidTransform(
        RotationMatrix(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
        [0.918, 0.0, 0.455],
    )


@dataclass(frozen=True, kw_only=True)
class HandPath:
    """The hand's desired motion: to and fro on a circle about the target, Eqs. (29)-(31).

    The angle on the circle is ``theta(t) = amplitude sin(omega t)``. Equation (30) has
    ``eps2 = +sin(theta / 2)``, which turns the line of sight away from the target; here the hand
    turns by ``-theta`` about its y axis, ``eps2 = -sin(theta / 2)``.

    Attributes:
        amplitude: Largest angle on the circle [rad], from 0 to below pi.
        distance: The circle's radius, from the hand to the target on its axis [m], positive.
        omega: Angular frequency of the swing [rad/s]; at 0 the hand stays at its first pose.
        X_WE0: The hand's first pose in the world (translation in m); Eq. (29) by default.

    Raises:
        ValueError: If a value is outside its range.

    Example:
        >>> path = HandPath(omega=0.314)
        >>> (1000 * path.CalcHandPose(5.0).translation()).round(1)
        array([ 945.3, -207.1,  455. ])
    """

    amplitude: float = math.radians(15.0)
    distance: float = 0.800
    omega: float = 0.105
    X_WE0: RigidTransform = field(default_factory=_MakeX_WE0)

    def __post_init__(self) -> None:
        """Checks the values; the comparisons are false for NaN."""
        if not 0.0 <= self.amplitude < math.pi:
            raise ValueError(
                f"hand path: amplitude must be from 0 to below pi rad, not {self.amplitude} rad"
            )
        if not 0.0 < self.distance < math.inf:
            raise ValueError(f"hand path: distance must be positive, not {self.distance} m")
        if not 0.0 <= self.omega < math.inf:
            raise ValueError(f"hand path: omega must be 0 or positive, not {self.omega} rad/s")
        if not np.all(np.isfinite(self.X_WE0.GetAsMatrix34())):
            raise ValueError("hand path: X_WE0 must be finite")

    def CalcAngle(self, t: float) -> float:
        """Angle ``theta`` on the circle [rad] at time ``t`` [s]."""
        return self.amplitude * math.sin(self.omega * t)

    def CalcHandPose(self, t: float) -> RigidTransform:
        """Pose ``X_WE`` of the hand (translation in m) at time ``t`` [s], Eqs. (30), (31)."""
        theta = self.CalcAngle(t)
        X_E0E = RigidTransform(
            RotationMatrix.MakeYRotation(-theta),
            [self.distance * math.sin(theta), 0.0, self.distance * (1.0 - math.cos(theta))],
        )
        return self.X_WE0 @ X_E0E

    def CalcHandVelocity(self, t: float) -> SpatialVelocity:
        """Spatial velocity ``V_WE`` of the hand, in the world [rad/s, m/s], at time ``t`` [s]."""
        theta = self.CalcAngle(t)
        rate = self.amplitude * self.omega * math.cos(self.omega * t)
        v = self.distance * rate * np.array([math.cos(theta), 0.0, math.sin(theta)])
        R_WE0 = self.X_WE0.rotation()
        return SpatialVelocity(w=R_WE0 @ np.array([0.0, -rate, 0.0]), v=R_WE0 @ v)

    def CalcTargetPosition(self) -> NDArray[np.float64]:
        """Position of the circle's center in the world [m], shape (3,)."""
        return self.X_WE0 @ np.array([0.0, 0.0, self.distance])


class _Arm:
    """Kinematics of the arm's hand with joint S3 at rest: damped Newton on Drake's Jacobian."""

    def __init__(self, plant: MultibodyPlant, frame_name: str) -> None:
        joints = [plant.GetJointByName(name) for name in JOINT_NAMES]
        self._plant = plant
        self._context = plant.CreateDefaultContext()
        self._frame = plant.GetFrameByName(frame_name)
        self._all_positions = plant.GetPositions(self._context)
        self._positions = [joint.position_start() for joint in joints]
        self._columns = [joints[i].velocity_start() for i in _FREE]
        self.lower = np.array([joint.position_lower_limits()[0] for joint in joints])
        self.upper = np.array([joint.position_upper_limits()[0] for joint in joints])
        self.speed = np.array([joint.velocity_upper_limits()[0] for joint in joints])

    def CalcPose(self, q: NDArray[np.float64]) -> RigidTransform:
        """Pose X_WE of the hand."""
        self._all_positions[self._positions] = q
        self._plant.SetPositions(self._context, self._all_positions)
        return self._frame.CalcPoseInWorld(self._context)

    def CalcPoseError(self, q: NDArray[np.float64], X_WE: RigidTransform) -> NDArray[np.float64]:
        """Rotation [rad] and translation [m] from the hand at ``q`` to ``X_WE``, in the world."""
        X_WH = self.CalcPose(q)
        R = X_WE.rotation().matrix() @ X_WH.rotation().matrix().T
        # sin(angle) axis: the rotation vector to second order, and zero where that is.
        turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        return np.concatenate((turn, X_WE.translation() - X_WH.translation()))

    def SolveStep(
        self, q: NDArray[np.float64], twist: NDArray[np.float64], damping: float
    ) -> NDArray[np.float64]:
        """Joint step or rate (7,) that moves the hand by a twist (6,), by damped least squares."""
        self.CalcPose(q)
        world = self._plant.world_frame()
        J = self._plant.CalcJacobianSpatialVelocity(
            self._context, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )[:, self._columns]
        step = np.zeros(NUM_JOINTS)
        step[_FREE] = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), twist)
        return step

    def CalcRate(self, q: NDArray[np.float64], V_WE: SpatialVelocity) -> NDArray[np.float64]:
        """Joint velocities (7,) [rad/s] at which the hand has the velocity ``V_WE``."""
        return self.SolveStep(q, V_WE.get_coeffs(), 1e-14)

    def SolvePose(self, X_WE: RigidTransform, guess: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint angles (7,) near ``guess`` that put the hand at ``X_WE``, or as near as it gets."""
        q = guess
        error = self.CalcPoseError(q, X_WE)
        factor = 1e-2
        for _ in range(100):
            if np.max(np.abs(error)) < _CONVERGED:
                break
            damping = factor * float(error @ error)  # It vanishes at the solution.
            trial = q + np.clip(self.SolveStep(q, error, damping + 1e-14), -0.5, 0.5)
            trial_error = self.CalcPoseError(trial, X_WE)
            if trial_error @ trial_error < error @ error:
                q, error, factor = trial, trial_error, max(0.1 * factor, 1e-2)
            else:
                factor *= 10.0
        return q

    def CheckPose(self, q: NDArray[np.float64], X_WE: RigidTransform, t: float) -> None:
        """Raises unless ``q`` puts the hand at ``X_WE`` within the joint limits."""
        where = f"hand path not reachable at t = {t:.2f} s:"
        error = np.abs(self.CalcPoseError(q, X_WE))
        if np.max(error) > 10.0 * _CONVERGED:
            raise UnreachablePathError(
                f"{where} no inverse-kinematics solution{self._DescribeElbow(q)}; the hand stays "
                f"{1e3 * np.linalg.norm(error[3:]):.3g} mm and "
                f"{math.degrees(np.linalg.norm(error[:3])):.2g} deg off. {_POSITION_REMEDY}"
            )
        for i, name in enumerate(JOINT_NAMES):
            if not self.lower[i] <= q[i] <= self.upper[i]:
                limit = self.lower[i] if q[i] < self.lower[i] else self.upper[i]
                raise UnreachablePathError(
                    f"{where} joint {name} would pass its limit {limit:.3f} rad "
                    f"(it needs {q[i]:.3f} rad). {_POSITION_REMEDY}"
                )

    def CheckRate(self, q: NDArray[np.float64], rate: NDArray[np.float64], t: float) -> None:
        """Raises when a joint velocity is beyond its limit."""
        excess = np.abs(rate) / self.speed
        i = int(np.argmax(excess))
        if excess[i] > 1.0:
            raise UnreachablePathError(
                f"hand path too fast at t = {t:.2f} s: joint {JOINT_NAMES[i]} would pass its "
                f"velocity limit {self.speed[i]:.4g} rad/s (it needs {abs(rate[i]):.4g} rad/s)"
                f"{self._DescribeElbow(q)}. "
                f"{_POSITION_REMEDY if self._DescribeElbow(q) else _VELOCITY_REMEDY}"
            )

    def _DescribeElbow(self, q: NDArray[np.float64]) -> str:
        return ", as the arm is almost stretched" if abs(q[_E1]) < 0.4 else ""

    def SolveStart(self, X_WE: RigidTransform) -> NDArray[np.float64]:
        """Joint angles, elbow up, of the path's first pose, which may be far from the nominal."""
        problem: UnreachablePathError | None = None
        for turn in np.radians([0.0, 60.0, -60.0, 120.0, -120.0]):
            q = np.array(NOMINAL_POSITIONS)
            q[_S1] += turn
            X_WN = self.CalcPose(q)
            # The way there in small steps, along which the elbow stays up.
            axis_angle = (X_WE.rotation() @ X_WN.rotation().inverse()).ToAngleAxis()
            for s in np.linspace(0.1, 1.0, 10):
                R = RotationMatrix(type(axis_angle)(s * axis_angle.angle(), axis_angle.axis()))
                p = (1.0 - s) * X_WN.translation() + s * X_WE.translation()
                q = self.SolvePose(RigidTransform(R @ X_WN.rotation(), p), q)
            try:
                self.CheckPose(q, X_WE, 0.0)
            except UnreachablePathError as error:
                problem = problem or error
            else:
                if q[_E1] >= 0.0:
                    return q
        raise problem or UnreachablePathError(
            "hand path not reachable at t = 0.00 s: no inverse-kinematics solution with the elbow "
            f"up. {_POSITION_REMEDY}"
        )


def SolveHandPath(
    plant: MultibodyPlant, path: HandPath, *, duration: float, frame_name: str = "hand"
) -> PiecewisePolynomial:
    """Solves for the joint motion along which the hand follows a path: inverse kinematics.

    Joint S3 resolves the arm's redundancy: it stays at 0, with the elbow up. The knots are exact;
    between them a cubic spline leaves the hand less than 1e-6 m and 1e-6 rad off.

    Args:
        plant: A finalized plant with the arm (see :func:`~mffdrake.systems.pa10.AddPa10`); whatever
            else it holds does not matter.
        path: The hand's desired motion in the world.
        duration: Length of the path [s], positive. The trajectory goes on for 0.1 s after it.
        frame_name: The frame that follows the path.

    Returns:
        The joint angles [rad], shape (7, 1), in the order of ``JOINT_NAMES``, with continuous
        velocities and accelerations.

    Raises:
        ValueError: If ``duration`` is not positive and finite.
        UnreachablePathError: If the path leaves the arm's reach, a joint's limits or a joint's
            velocity limit. The message names the time, the joint and the remedy.

    Example:
        >>> from mffdrake.systems.pa10 import MakePa10Plant
        >>> trajectory = SolveHandPath(MakePa10Plant(), HandPath(omega=0.314), duration=5.0)
        >>> np.degrees(trajectory.value(5.0)).round(1).ravel() + 0.0
        array([-21.6,  40.1,   0. ,  74. , -61.2, -42.8,  53.1])
    """
    if not 0.0 < duration < math.inf:
        raise ValueError(f"SolveHandPath: duration must be positive, not {duration} s")
    arm = _Arm(plant, frame_name)
    start = arm.SolveStart(path.CalcHandPose(0.0))
    span = duration + _MARGIN
    # The joints repeat their motion with every swing: solve for one only.
    swing, step = _MAX_STEP, _MAX_STEP
    if path.omega > 0.0:
        swing = min(span, 2.0 * math.pi / path.omega)
        step = max(_MIN_STEP, min(_MAX_STEP, _PHASE_STEP / path.omega))
    num_steps = math.ceil(swing / step)
    while True:
        step = swing / num_steps
        knots, rates = _March(arm, path, start, step, num_steps)
        # All knots until the end; the last of a whole swing is the first of the next one.
        num_knots = num_steps if swing < span else num_steps + 1
        index = np.arange(math.ceil(span / step - 1e-9) + 1) % num_knots
        trajectory = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            step * np.arange(len(index)),
            knots[index].T,
            rates[index[:1]].T,
            rates[index[-1:]].T,
        )
        midway = step * (np.arange(num_steps) + 0.5)
        errors = [
            np.max(np.abs(arm.CalcPoseError(q, path.CalcHandPose(t))))
            for q, t in zip(trajectory.vector_values(midway).T, midway, strict=True)
        ]
        if max(errors) < _MIDWAY_ERROR or step <= _MIN_STEP:
            return trajectory
        num_steps *= 2


def _March(
    arm: _Arm, path: HandPath, start: NDArray[np.float64], step: float, num_steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Joint angles and velocities at ``num_steps + 1`` times, each found from the one before."""
    knots: list[NDArray[np.float64]] = []
    rates: list[NDArray[np.float64]] = []
    for k in range(num_steps + 1):
        t = k * step
        X_WE = path.CalcHandPose(t)
        q = start
        if knots:  # Adams-Bashforth from the last two knots.
            q = knots[-1] + step * (1.5 * rates[-1] - 0.5 * rates[max(k - 2, 0)])
        q = arm.SolvePose(X_WE, q)
        arm.CheckPose(q, X_WE, t)
        rate = arm.CalcRate(q, path.CalcHandVelocity(t))
        arm.CheckRate(q, rate, t)
        if knots:  # A jump to another branch of solutions shows here.
            arm.CheckRate(q, (q - knots[-1]) / step, t)
        knots.append(q)
        rates.append(rate)
    return np.array(knots), np.array(rates)


def AddHandPathSource(
    builder: DiagramBuilder, trajectory: PiecewisePolynomial, *, name: str = "hand_path"
) -> TrajectorySource:
    """Adds the source of the arm's desired state.

    Args:
        builder: The builder of the diagram.
        trajectory: Joint angles over time, from :func:`SolveHandPath`.
        name: The system's name.

    Returns:
        A system with one output port of size 14: the desired joint angles [rad], then the
        velocities [rad/s]. After the trajectory's end the angles stay and the velocities are zero.
    """
    source = builder.AddSystem(TrajectorySource(trajectory, output_derivative_order=1))
    source.set_name(name)
    return source
