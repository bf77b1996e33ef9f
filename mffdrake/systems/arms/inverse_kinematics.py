"""Inverse kinematics of an arm's hand, and what to say where there is none.

Frames, in Drake's monogram notation: W world, E the frame that is led (the hand).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from mffdrake.recognition.parameters import InputError
from mffdrake.systems.arms.arm_joints import POSE_SIZE, CheckPosture, MovingJoints, UnitOf
from mffdrake.systems.arms.elbow import Elbow
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

__all__ = ["ArmKinematics", "UnreachablePathError"]

_CONVERGED = 1e-10  # Pose error [m, rad] at which the search ends,
_SOLVED = 1e-8  # and below which it counts as a solution.
_STRETCHED = 0.4  # Bend of the elbow [rad] below which the arm is close to the end of its reach.
_SINGULAR = 0.02  # Singular value of the Jacobian below which the hand barely moves some way.
_CONVEX = 0.1  # Least curvature along the arm's own motion that Newton's step may trust.
_POSITION_REMEDY = "Reduce the path's amplitude or distance, or move X_WE0."
_VELOCITY_REMEDY = "Reduce the path's omega or amplitude."


class UnreachablePathError(InputError, ValueError):
    """The arm cannot follow the path; the message says when, why and what to change.

    Example:
        >>> from mffdrake.systems.arms.hand_path import HandPath, SolveHandPath
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> try:
        ...     SolveHandPath(MakePa10Plant(), HandPath(omega=5.0), duration=1.0)
        ... except UnreachablePathError as error:
        ...     print(str(error).partition(":")[0])
        hand path too fast at t = 0.00 s
    """


class ArmKinematics:
    """Solves for the joint angles of a hand pose: damped Newton steps on Drake's Jacobian.

    An arm with more joints than a pose needs can hold some: they stay where the guess has them. If
    more than six are left, the solution is the one nearest to the nominal posture, the minimum of
    ``|q - nominal|^2`` among those with the hand in its pose. So it depends on that pose alone.

    Args:
        plant: A finalized plant with the arm; whatever else it holds stays at its default.
        frame_name: The frame that is led.
        model_instance: The arm; by default the model with that frame.
        nominal: Nominal posture [rad, or m where a joint slides], shape (n,); the PA-10's by
            default.
        held_joints: Names of the joints that are held; the PA-10's S3 by default.

    Raises:
        ArmError: If the posture or the held joints do not fit the arm.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> arm = ArmKinematics(MakePa10Plant())
        >>> X_WE = arm.CalcPose(np.radians([0.0, 20.0, 0.0, 80.0, 0.0, -40.0, 0.0]))
        >>> np.degrees(arm.SolvePose(X_WE, NOMINAL_POSITIONS)).round(3) + 0.0
        array([  0.,  20.,   0.,  80.,   0., -40.,   0.])
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        *,
        frame_name: str = "hand",
        model_instance: ModelInstanceIndex | None = None,
        nominal: ArrayLike = NOMINAL_POSITIONS,
        held_joints: Sequence[str] = ("S3",),
    ) -> None:
        self._plant = plant
        self._context = plant.CreateDefaultContext()
        if model_instance is None:
            model_instance = plant.GetFrameByName(frame_name).model_instance()
        self._frame = plant.GetFrameByName(frame_name, model_instance)
        self._joints = joints = MovingJoints(plant, model_instance)
        self._nominal = np.array(nominal, dtype=float)
        CheckPosture(joints, self._nominal, held_joints)
        self._all_positions = plant.GetPositions(self._context)
        self._positions = [joint.position_start() for joint in joints]
        self._free = [i for i, joint in enumerate(joints) if joint.name() not in held_joints]
        self._columns = [joints[i].velocity_start() for i in self._free]
        self._lower = np.array([joint.position_lower_limits()[0] for joint in joints])
        self._upper = np.array([joint.position_upper_limits()[0] for joint in joints])
        self._speed = np.array([joint.velocity_upper_limits()[0] for joint in joints])
        self._redundant = len(self._free) > POSE_SIZE
        self.CalcPose(self._nominal)
        self._elbow = Elbow.Find(joints, self._context)

    def CalcPose(self, q: NDArray[np.float64]) -> RigidTransform:
        """Pose ``X_WE`` of the hand (translation in m) at the joint angles ``q`` (n,) [rad]."""
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

    def CalcNominalError(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far ``q`` (n,) is from the nearest to nominal, along the free joints' own motion.

        It is the part of ``q - nominal`` that leaves the hand where it is [rad, m], shape (m - 6,)
        for m free joints: zero at a solution.
        """
        own_motion = np.linalg.svd(self._CalcJacobian(q))[2][6:]
        return own_motion @ (q - self._nominal)[self._free]

    def _CalcJacobian(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity of the hand in W, rotation first, by the free joints' rates: (6, m)."""
        self.CalcPose(q)
        world = self._plant.world_frame()
        return self._plant.CalcJacobianSpatialVelocity(
            self._context, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )[:, self._columns]

    def _SolveStep(
        self, q: NDArray[np.float64], twist: NDArray[np.float64], damping: float
    ) -> NDArray[np.float64]:
        """Joint step or rate (n,) that moves the hand by a twist (6,), by damped least squares."""
        J = self._CalcJacobian(q)
        step = np.zeros(len(self._joints))
        step[self._free] = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), twist)
        return step

    def _SolveNearNominal(
        self, q: NDArray[np.float64], twist: NDArray[np.float64], pull: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Joint step or rate (n,) that moves the hand by a twist (6,), nearest to nominal.

        Newton's step for the conditions of the minimum, ``q - nominal = J' multipliers``: along the
        arm's own motion it takes ``pull`` (m,), the distance from nominal, to zero.
        """
        J = self._CalcJacobian(q)
        U, S, Vt = np.linalg.svd(J)
        across, own_motion = Vt[:6] / (S + 1e-12)[:, np.newaxis], Vt[6:]
        least = across.T @ (U.T @ twist)
        multipliers = U @ (across @ (q - self._nominal)[self._free])
        H = np.eye(len(self._free)) - _CalcCurvature(J, multipliers)
        H_own = own_motion @ H @ own_motion.T
        if np.min(np.linalg.eigvalsh(0.5 * (H_own + H_own.T))) < _CONVEX:  # Far from a minimum.
            H, H_own = np.eye(len(self._free)), np.eye(len(own_motion))
        own = np.linalg.solve(H_own, own_motion @ (pull + H @ least))
        step = np.zeros(len(self._joints))
        step[self._free] = least - own_motion.T @ own
        return step

    def SolveVelocity(self, q: NDArray[np.float64], V_WE: SpatialVelocity) -> NDArray[np.float64]:
        """Joint velocities (n,) [rad/s] at which the hand at ``q`` has the velocity ``V_WE``."""
        if self._redundant:
            return self._SolveNearNominal(q, V_WE.get_coeffs(), np.zeros(len(self._free)))
        return self._SolveStep(q, V_WE.get_coeffs(), 1e-14)

    def SolvePose(self, X_WE: RigidTransform, guess: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint angles (n,) near ``guess`` that put the hand at ``X_WE``, or as near as it gets."""
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
        if self._redundant and np.max(np.abs(error)) < _SOLVED:
            return self._ApproachNominal(X_WE, q)
        return q

    def _ApproachNominal(self, X_WE: RigidTransform, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """From a solution to the one nearest to nominal."""
        for _ in range(100):
            pull = (q - self._nominal)[self._free]
            step = self._SolveNearNominal(q, self.CalcPoseError(q, X_WE), pull)
            q = q + np.clip(step, -0.2, 0.2)
            if np.max(np.abs(step)) < _CONVERGED:
                break
        return q

    def CheckPose(self, q: NDArray[np.float64], X_WE: RigidTransform, t: float) -> None:
        """Raises UnreachablePathError unless ``q`` leads the hand to ``X_WE`` within all limits."""
        where = f"hand path not reachable at t = {t:.2f} s:"
        error = np.abs(self.CalcPoseError(q, X_WE))
        if np.max(error) > _SOLVED:
            raise UnreachablePathError(
                f"{where} no inverse-kinematics solution{self._CalcReason(q)}; the hand stays "
                f"{1e3 * np.linalg.norm(error[3:]):.3g} mm and "
                f"{math.degrees(np.linalg.norm(error[:3])):.2g} deg off. {_POSITION_REMEDY}"
            )
        if self._redundant and np.max(np.abs(self.CalcNominalError(q))) > _SOLVED:
            raise UnreachablePathError(
                f"{where} no posture is the nearest to the nominal one. "
                "Change nominal_deg, or hold a joint by held_joints."
            )
        for i, joint in enumerate(self._joints):
            if not self._lower[i] <= q[i] <= self._upper[i]:
                limit = self._lower[i] if q[i] < self._lower[i] else self._upper[i]
                raise UnreachablePathError(
                    f"{where} joint {joint.name()} would pass its limit {limit:.3f} "
                    f"{UnitOf(joint)} (it needs {q[i]:.3f} {UnitOf(joint)}). {_POSITION_REMEDY}"
                )

    def CheckVelocity(self, q: NDArray[np.float64], v: NDArray[np.float64], t: float) -> None:
        """Raises UnreachablePathError when a joint velocity in ``v`` (n,) passes its limit."""
        excess = np.abs(v) / self._speed
        i = int(np.argmax(excess))
        if excess[i] > 1.0:
            # Just before the end of the reach, any speed is too high.
            reason = self._CalcReason(q)
            unit = f"{UnitOf(self._joints[i])}/s"
            raise UnreachablePathError(
                f"hand path too fast at t = {t:.2f} s: joint {self._joints[i].name()} would pass "
                f"its velocity limit {self._speed[i]:.4g} {unit} (it needs {abs(v[i]):.4g} {unit})"
                f"{reason}. {_POSITION_REMEDY if reason else _VELOCITY_REMEDY}"
            )

    def _CalcReason(self, q: NDArray[np.float64]) -> str:
        """What makes the posture ``q`` a bad one, if anything does."""
        J = self._CalcJacobian(q)
        if self._elbow is not None and abs(self._elbow.CalcBend(self._context)) < _STRETCHED:
            return ", as the arm is almost stretched"
        return ", near a singular pose" if np.linalg.svd(J)[1][-1] < _SINGULAR else ""

    def _IsBentAsNominal(self, q: NDArray[np.float64]) -> bool:
        self.CalcPose(q)
        return self._elbow is None or self._elbow.IsBentAsFound(self._context)

    def SolveStart(self, X_WE: RigidTransform) -> NDArray[np.float64]:
        """Joint angles (n,) of a pose that may be far from the nominal, with the elbow bent alike.

        Raises:
            UnreachablePathError: If there is none.
        """
        problem: UnreachablePathError | None = None
        # A base that turns may have to turn far.
        turns = [0.0, 60.0, -60.0, 120.0, -120.0] if self._CanTurn() else [0.0]
        for turn in np.radians(turns):
            q = np.array(self._nominal)
            q[0] += turn
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
                if self._IsBentAsNominal(q):
                    return q
        raise problem or UnreachablePathError(
            "hand path not reachable at t = 0.00 s: no inverse-kinematics solution with joint "
            f"{self._elbow.name if self._elbow else ''} bent to the nominal side. "
            f"{_POSITION_REMEDY}"
        )

    def _CanTurn(self) -> bool:
        return 0 in self._free and UnitOf(self._joints[0]) == "rad"


def _CalcCurvature(J: NDArray[np.float64], multipliers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivative of ``J' multipliers`` by the joint angles, (m, m), for a chain of m joints.

    A joint turns the columns of those after it; it moves the hand on which those before it act.
    """
    w, v = J[:3].T, J[3:].T
    turn = np.cross(w, multipliers[:3]) @ w.T  # of joint i's axis by joint j
    move = np.cross(multipliers[3:], w) @ v.T  # by joint i of the hand, which joint j moves
    return np.tril(turn + move.T) + np.triu(move, 1)
