"""The arm's joint controller: PD with zero-order hold, its gains, and gravity compensation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import BasicVector, LeafSystem

from mffdrake.systems.timing import Timing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, OutputPort

__all__ = ["PD_GAINS", "AddGravityCompensation", "PdController", "PdGains"]


@dataclass(frozen=True, kw_only=True)
class PdGains:
    kp: tuple[float, ...]
    kd: tuple[float, ...]


class PdController(LeafSystem):
    """Torques of a PD controller in joint space, computed once a control period and held.

    .. pydrake_system::

        name: PdController
        input_ports:
        - estimated_state
        - desired_state
        - feedforward_torque (optional)
        output_ports:
        - actuation
    """

    def __init__(
        self,
        *,
        kp: Sequence[float] | NDArray[np.float64],
        kd: Sequence[float] | NDArray[np.float64],
        effort_limit: Sequence[float] | NDArray[np.float64] | None = None,
        timing: Timing | None = None,
    ) -> None:
        LeafSystem.__init__(self)
        self._gains = np.hstack((np.diag(kp), np.diag(kd)))
        n = len(kp)
        limit = np.full(n, np.inf) if effort_limit is None else np.array(effort_limit, float)
        self._upper, self._lower = limit, -limit
        self._estimated = self.DeclareVectorInputPort("estimated_state", BasicVector(2 * n))
        self._desired = self.DeclareVectorInputPort("desired_state", BasicVector(2 * n))
        self._feedforward = self.DeclareVectorInputPort("feedforward_torque", BasicVector(n))
        self.DeclareStateOutputPort("actuation", self.DeclareDiscreteState(n))
        period = (timing or Timing()).control_period
        self.DeclareInitializationDiscreteUpdateEvent(self._Update)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._Update)
        self.DeclareForcedDiscreteUpdateEvent(self._Update)

    def _Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        torque = self._gains @ (self._desired.Eval(context) - self._estimated.Eval(context))
        if self._feedforward.HasValue(context):
            torque += self._feedforward.Eval(context)
        discrete_state.set_value(np.minimum(np.maximum(torque, self._lower), self._upper))


def AddGravityCompensation(builder, *, arm_plant, controller, estimated_state):
    gravity = builder.AddSystem(
        InverseDynamics(arm_plant, InverseDynamics.InverseDynamicsMode.kGravityCompensation)
    )
    builder.Connect(estimated_state, gravity.get_input_port_estimated_state())
    builder.Connect(gravity.get_output_port(), controller.GetInputPort("feedforward_torque"))
    return gravity
