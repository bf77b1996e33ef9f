"""A target whose motion is prescribed, as a system."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from mffdrake.systems.callbacks import WeakCallback

__all__ = ["PrescribedTarget"]


class PrescribedTarget(LeafSystem):
    """Tells where a target truly is: with the ports of a `TargetMotionEstimator` that never errs.

    .. pydrake_system::

        name: PrescribedTarget
        output_ports:
        - X_WM
        - target_velocity
        - is_known

    Ports:
        X_WM: The target's pose in the world, as a RigidTransform.
        target_velocity: Its linear [m/s] and angular velocity [rad/s] in the world, shape (6,).
        is_known: 1, shape (1,).

    Args:
        pose: The pose X_WM at a time [s].
        velocity: The velocity at a time [s], shape (6,).

    Example:
        >>> still = PrescribedTarget(lambda t: RigidTransform(), lambda t: np.zeros(6))
        >>> still.GetOutputPort("is_known").Eval(still.CreateDefaultContext())
        array([1.])
    """

    def __init__(
        self,
        pose: Callable[[float], RigidTransform],
        velocity: Callable[[float], NDArray[np.float64]],
    ) -> None:
        super().__init__()
        self._pose, self._velocity = pose, velocity
        from_time = {self.time_ticket()}
        self.DeclareAbstractOutputPort(
            "X_WM",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcPose),
            from_time,
        )
        self.DeclareVectorOutputPort(
            "target_velocity", 6, WeakCallback(self._CalcVelocity), from_time
        )
        self.DeclareVectorOutputPort("is_known", 1, WeakCallback(self._CalcIsKnown), from_time)

    def _CalcPose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._pose(context.get_time()))

    def _CalcVelocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._velocity(context.get_time()))

    def _CalcIsKnown(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([1.0])
