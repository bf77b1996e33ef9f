"""Inverse kinematics of the arm's hand, and what to say where there is none.

Frames, in Drake's monogram notation: W world, E the frame that is led (the hand).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from mffdrake.systems.pa10 import JOINT_NAMES, NOMINAL_POSITIONS, NUM_JOINTS

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.plant import MultibodyPlant

__all__ = ["ArmKinematics", "UnreachablePathError"]

_S1, _S3, _E1 = (JOINT_NAMES.index(name) for name in ("S1", "S3", "E1"))
_FREE = [i for i in range(NUM_JOINTS) if i != _S3]

_CONVERGED = 1e-10  # Pose error [m, rad] at which the search ends,
_SOLVED = 1e-8  # and below which it counts as a solution.
_STRETCHED = 0.4  # E1 [rad] below which the arm is close to the end of its reach.
_POSITION_REMEDY = "Reduce the path's amplitude or distance, or move X_WE0."
_VELOCITY_REMEDY = "Reduce the path's omega or amplitude."


class UnreachablePathError(ValueError):
    """The arm cannot follow the path; the message says when, why and what to change."""


class ArmKinematics:
    """Solves for the joint angles of a hand pose: damped Newton steps on Drake's Jacobian.

    The arm has one joint more than a pose needs: S3 stays where the guess has it.

    Args:
        plant: A finalized plant with the arm; whatever else it holds stays at its default.
        frame_name: The frame that is led.

    Example:
        >>> from mffdrake.systems.pa10 import MakePa10Plant
        >>> arm = ArmKinematics(MakePa10Plant())
        >>> X_WE = arm.CalcPose(np.radians([0.0, 20.0, 0.0, 80.0, 0.0, -40.0, 0.0]))
        >>> np.degrees(arm.SolvePose(X_WE, NOMINAL_POSITIONS)).round(3) + 0.0
        array([  0.,  20.,   0.,  80.,   0., -40.,   0.])
    """

    def __init__(self, plant: MultibodyPlant, *, frame_name: str = "hand") -> None:
        joints = [plant.GetJointByName(name) for name in JOINT_NAMES]
        self._plant = plant
        self._context = plant.CreateDefaultContext()
        self._frame = plant.GetFrameByName(frame_name)
        self._all_positions = plant.GetPositions(self._context)
        self._positions = [joint.position_start() for joint in joints]
        self._columns = [joints[i].velocity_start() for i in _FREE]
        self._lower = np.array([joint.position_lower_limits()[0] for joint in joints])
        self._upper = np.array([joint.position_upper_limits()[0] for joint in joints])
        self._speed = np.array([joint.velocity_upper_limits()[0] for joint in joints])

    def CalcPose(self, q: NDArray[np.float64]) -> RigidTransform:
        """Pose ``X_WE`` of the hand (translation in m) at the joint angles ``q`` (7,) [rad]."""
        self._all_positions[self._positions] = q
        self._plant.SetPositions(self._context, self._all_positions)
        return self._frame.CalcPoseInWorld(self._context)

    def CalcPoseError(self, q: NDArray[np.float64], X_WE: RigidTransform) -> NDArray[np.float64]:
        """Rotation [rad] and translation [m], (6,), from the hand at ``q`` to ``X_WE``, in W."""
        X_WH = self.CalcPose(q)
        R = X_WE.rotation().matrix() @ X_WH.rotation().matrix().T
        # sin(angle) axis: the rotation vector to second order, and zero where that is.
        turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        return np.concatenate((turn, X_WE.translation() - X_WH.translation()))

    def _SolveStep(
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

    def SolveVelocity(self, q: NDArray[np.float64], V_WE: SpatialVelocity) -> NDArray[np.float64]:
        """Joint velocities (7,) [rad/s] at which the hand at ``q`` has the velocity ``V_WE``."""
        return self._SolveStep(q, V_WE.get_coeffs(), 1e-14)

    def SolvePose(self, X_WE: RigidTransform, guess: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint angles (7,) near ``guess`` that put the hand at ``X_WE``, or as near as it gets."""
        q = guess
        error = self.CalcPoseError(q, X_WE)
        factor = 1e-2
        for _ in range(100):
            if np.max(np.abs(error)) < _CONVERGED:
                break
            damping = factor * float(error @ error)  # It vanishes at the solution.
            trial = q + np.clip(self._SolveStep(q, error, damping + 1e-14), -0.5, 0.5)
            trial_error = self.CalcPoseError(trial, X_WE)
            if trial_error @ trial_error < error @ error:
                q, error, factor = trial, trial_error, max(0.1 * factor, 1e-2)
            else:
                factor *= 10.0
        return q

    def CheckPose(self, q: NDArray[np.float64], X_WE: RigidTransform, t: float) -> None:
        """Raises UnreachablePathError unless ``q`` leads the hand to ``X_WE`` within all limits."""
        where = f"hand path not reachable at t = {t:.2f} s:"
        error = np.abs(self.CalcPoseError(q, X_WE))
        if np.max(error) > _SOLVED:
            reason = ", as the arm is almost stretched" if abs(q[_E1]) < _STRETCHED else ""
            raise UnreachablePathError(
                f"{where} no inverse-kinematics solution{reason}; the hand stays "
                f"{1e3 * np.linalg.norm(error[3:]):.3g} mm and "
                f"{math.degrees(np.linalg.norm(error[:3])):.2g} deg off. {_POSITION_REMEDY}"
            )
        for i, name in enumerate(JOINT_NAMES):
            if not self._lower[i] <= q[i] <= self._upper[i]:
                limit = self._lower[i] if q[i] < self._lower[i] else self._upper[i]
                raise UnreachablePathError(
                    f"{where} joint {name} would pass its limit {limit:.3f} rad "
                    f"(it needs {q[i]:.3f} rad). {_POSITION_REMEDY}"
                )

    def CheckVelocity(self, q: NDArray[np.float64], v: NDArray[np.float64], t: float) -> None:
        """Raises UnreachablePathError when a joint velocity in ``v`` (7,) passes its limit."""
        excess = np.abs(v) / self._speed
        i = int(np.argmax(excess))
        if excess[i] > 1.0:
            reason, remedy = "", _VELOCITY_REMEDY
            if abs(q[_E1]) < _STRETCHED:  # Just before the end of the reach, any speed is too high.
                reason, remedy = ", as the arm is almost stretched", _POSITION_REMEDY
            raise UnreachablePathError(
                f"hand path too fast at t = {t:.2f} s: joint {JOINT_NAMES[i]} would pass its "
                f"velocity limit {self._speed[i]:.4g} rad/s (it needs {abs(v[i]):.4g} rad/s)"
                f"{reason}. {remedy}"
            )

    def SolveStart(self, X_WE: RigidTransform) -> NDArray[np.float64]:
        """Joint angles (7,) of a pose that may be far from the nominal, with S3 = 0, elbow up.

        Raises:
            UnreachablePathError: If there is none.
        """
        problem: UnreachablePathError | None = None
        for turn in np.radians([0.0, 60.0, -60.0, 120.0, -120.0]):
            q = np.array(NOMINAL_POSITIONS)
            q[_S1] += turn
            X_WN = self.CalcPose(q)
            turning = (X_WE.rotation() @ X_WN.rotation().inverse()).ToAngleAxis()
            for s in np.linspace(0.1, 1.0, 10):  # In small steps, so that the elbow stays up.
                R = RotationMatrix(AngleAxis(angle=s * turning.angle(), axis=turning.axis()))
                p = (1.0 - s) * X_WN.translation() + s * X_WE.translation()
                q = self.SolvePose(RigidTransform(R @ X_WN.rotation(), p), q)
            try:
                self.CheckPose(q, X_WE, 0.0)
            except UnreachablePathError as error:
                problem = problem or error
            else:
                if q[_E1] > 0.0:
                    return q
        raise problem or UnreachablePathError(
            "hand path not reachable at t = 0.00 s: no inverse-kinematics solution with the elbow "
            f"up. {_POSITION_REMEDY}"
        )
