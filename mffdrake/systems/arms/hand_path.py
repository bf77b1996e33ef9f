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
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.systems.arms.inverse_kinematics import ArmKinematics, UnreachablePathError
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex
    from pydrake.systems.framework import DiagramBuilder

__all__ = ["AddHandPathSource", "HandPath", "SolveHandPath", "UnreachablePathError"]

_MARGIN = 0.1  # [s] of trajectory after the end, so that a source has a value at the end's ulp.
_PHASE_STEP = 0.02  # [rad] of the path's phase omega t from knot to knot,
_MAX_STEP = 0.1  # but at most this time,
_MIN_STEP = 0.001  # Knots nearer than this [s] help nobody.
_MIDWAY_ERROR = 1e-6  # Largest pose error halfway between two knots [m, rad].


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


def SolveHandPath(
    plant: MultibodyPlant,
    path: HandPath,
    *,
    duration: float,
    frame_name: str = "hand",
    model_instance: ModelInstanceIndex | None = None,
    nominal: ArrayLike = NOMINAL_POSITIONS,
    held_joints: Sequence[str] = ("S3",),
) -> PiecewisePolynomial:
    """Solves for the joint motion along which the hand follows a path: inverse kinematics.

    The PA-10 holds joint S3 at 0 and keeps the elbow up. Any other arm holds its own joints, or
    none: what redundancy is left is resolved by staying near the nominal posture (see
    `ArmKinematics`), and the joints repeat their motion with every swing. The knots are exact;
    between them a cubic spline leaves the hand less than 1e-6 m and 1e-6 rad off.

    Args:
        plant: A finalized plant with the arm (see :class:`~mffdrake.systems.arms.arm.ArmModel`);
            whatever else it holds does not matter.
        path: The hand's desired motion in the world.
        duration: Length of the path [s], positive. The trajectory goes on for 0.1 s after it.
        frame_name: The frame that follows the path.
        model_instance: The arm; by default the model with that frame.
        nominal: Nominal posture [rad, or m where a joint slides], shape (n,); its elbow tells to
            which side the arm is bent.
        held_joints: Names of the joints that stay at their nominal angle.

    Returns:
        The joint angles [rad], shape (n, 1), base to tip, with continuous velocities and
        accelerations.

    Raises:
        ValueError: If ``duration`` is not positive and finite.
        ArmError: If the posture or the held joints do not fit the arm.
        UnreachablePathError: If the path leaves the arm's reach, a joint's limits or a joint's
            velocity limit. The message names the time, the joint and the remedy.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> trajectory = SolveHandPath(MakePa10Plant(), HandPath(omega=0.314), duration=5.0)
        >>> np.degrees(trajectory.value(5.0)).round(1).ravel() + 0.0
        array([-21.6,  40.1,   0. ,  74. , -61.2, -42.8,  53.1])
    """
    if not 0.0 < duration < math.inf:
        raise ValueError(f"SolveHandPath: duration must be positive, not {duration} s")
    arm = ArmKinematics(
        plant,
        frame_name=frame_name,
        model_instance=model_instance,
        nominal=nominal,
        held_joints=held_joints,
    )
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
    arm: ArmKinematics, path: HandPath, start: NDArray[np.float64], step: float, num_steps: int
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
        rate = arm.SolveVelocity(q, path.CalcHandVelocity(t))
        arm.CheckVelocity(q, rate, t)
        if knots:  # A jump to another branch of solutions shows here.
            arm.CheckVelocity(q, (q - knots[-1]) / step, t)
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
        A system with one output port of size 2n: the desired joint angles [rad], then the
        velocities [rad/s]. After the trajectory's end the angles stay and the velocities are zero.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> from pydrake.systems.framework import DiagramBuilder
        >>> trajectory = SolveHandPath(MakePa10Plant(), HandPath(), duration=1.0)
        >>> source = AddHandPathSource(DiagramBuilder(), trajectory)
        >>> source.get_output_port().size()  # of seven joints
        14
    """
    source = builder.AddSystem(TrajectorySource(trajectory, output_derivative_order=1))
    source.set_name(name)
    return source
