"""The arm's joint controller: PD with a zero-order hold, and gravity compensation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    MatrixGain,
    PassThrough,
    Saturation,
    ZeroOrderHold,
)

from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.timing import Timing

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.framework import Context, DiscreteValues, InputPort, OutputPort

__all__ = ["AddComputedTorque", "AddGravityCompensation", "PdController"]


class PdController(Diagram):
    """Torques of a PD controller in joint space, computed once a control period and then held.

    .. pydrake_system::

        name: PdController
        input_ports:
        - estimated_state
        - desired_state
        - feedforward_torque (optional)
        output_ports:
        - actuation

    With n joints, the states are joint angles [rad], then velocities [rad/s], of size 2n; the
    torques [N m] are of size n. At every control tick::

        actuation = clip(kp (q_d - q) + kd (v_d - v) + feedforward_torque, +-effort_limit)

    The torque computed from the state of one tick acts on the plant from the next tick on, as on a
    real robot; until then the old one is held. The output depends on the discrete state only, so
    there is no algebraic loop through the plant. At initialization the controller computes its
    first torque, so that the arm does not fall during the first tick. (The event at time 0 then
    computes the same torque again.) ``CalcForcedDiscreteVariableUpdate()`` updates it at any time.

    All of that is done by systems of Drake, in C++, as it happens every millisecond. What is not a
    number at an input makes torques that are none.

    Args:
        kp: Stiffness [N m/rad], shape (n,), at least 0.
        kd: Damping [N m s/rad], shape (n,), at least 0. With a stiffness, keep it above ``kp``
            times the control period: the hold takes that much off it.
        effort_limit: Largest torque of each joint [N m], shape (n,), positive; None for no limit.
        timing: Gives the control period; 1 ms by default.

    Raises:
        ValueError: If a vector has the wrong shape or an invalid entry.

    Example:
        >>> controller = PdController(kp=[100.0], kd=[10.0], effort_limit=[5.0])
        >>> context = controller.CreateDefaultContext()
        >>> estimated, desired, _ = (controller.get_input_port(i) for i in range(3))
        >>> _ = estimated.FixValue(context, [0.00, 0.0])
        >>> _ = desired.FixValue(context, [0.02, 0.1])
        >>> state = context.get_mutable_discrete_state()
        >>> controller.CalcForcedDiscreteVariableUpdate(context, state)
        >>> controller.get_output_port().Eval(context)
        array([3.])
    """

    def __init__(
        self,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        effort_limit: ArrayLike | None = None,
        timing: Timing | None = None,
    ) -> None:
        Diagram.__init__(self)
        n = np.size(kp)
        if n == 0:
            raise ValueError("PdController: kp must have one number a joint, but is empty")
        kp, kd = _CheckVector("kp", kp, n), _CheckVector("kd", kd, n)
        limit = np.full(n, np.inf)
        if effort_limit is not None:
            limit = _CheckVector("effort_limit", effort_limit, n, finite=False)
            if np.any(limit == 0.0):
                raise ValueError(f"PdController: effort_limit must be positive, not {limit}")
        builder = DiagramBuilder()

        # As few systems as can be: each takes its time every millisecond.
        gains = np.hstack((np.diag(kp), np.diag(kd)))
        torque = builder.AddNamedSystem("torque", Adder(3, n))
        for port, (name, system) in enumerate(
            {
                "estimated_state": MatrixGain(-gains),
                "desired_state": MatrixGain(gains),
                "feedforward_torque": PassThrough(np.zeros(n)),  # zeros by default
            }.items()
        ):
            builder.AddNamedSystem(name, system)
            builder.ExportInput(system.get_input_port(), name)
            builder.Connect(system.get_output_port(), torque.get_input_port(port))
        clipped = builder.AddNamedSystem("effort_limit", Saturation(-limit, limit))
        builder.Connect(torque.get_output_port(), clipped.get_input_port())
        hold = builder.AddNamedSystem("hold", _Hold((timing or Timing()).control_period, n))
        builder.Connect(clipped.get_output_port(), hold.get_input_port())
        builder.ExportOutput(hold.get_output_port(), "actuation")
        builder.BuildInto(self)


class _Hold(ZeroOrderHold):
    """A zero-order hold that takes its first value at initialization, and one whenever forced."""

    def __init__(self, period: float, size: int) -> None:
        ZeroOrderHold.__init__(self, period, size)
        self.DeclareInitializationDiscreteUpdateEvent(WeakCallback(self._Take))
        self.DeclareForcedDiscreteUpdateEvent(WeakCallback(self._Take))

    def _Take(self, context: Context, discrete_state: DiscreteValues) -> None:
        discrete_state.set_value(self.get_input_port().Eval(context))


def AddGravityCompensation(
    builder: DiagramBuilder,
    *,
    arm_plant: MultibodyPlant,
    estimated_state: OutputPort,
    feedforward_torque: InputPort,
    name: str = "gravity_compensation",
) -> InverseDynamics:
    """Adds the torques that carry the arm's weight, and connects them to a controller.

    Without them, the soft gains of
    :meth:`~mffdrake.systems.control.pd_gains.PdGains.LightlyDamped` let joint S2 give way by 20 deg
    under the weight of the arm alone.

    Args:
        builder: The builder of the diagram.
        arm_plant: The controller's model of the arm alone, with the n joints of the controller;
            see :meth:`~mffdrake.systems.arms.arm.ArmModel.MakePlant`.
        estimated_state: The output port with the arm's state, of size 2n.
        feedforward_torque: The controller's input port of that name, of size n.
        name: The system's name.

    Returns:
        Drake's own system, which computes the torques where gravity's are balanced.

    Example:
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> from mffdrake.systems.control.pd_gains import PdGains
        >>> from pydrake.systems.framework import DiagramBuilder
        >>> builder = DiagramBuilder()
        >>> arm = builder.AddSystem(MakePa10Plant(0.001))
        >>> gains = PdGains.LightlyDamped()
        >>> controller = builder.AddSystem(PdController(kp=gains.kp, kd=gains.kd))
        >>> AddGravityCompensation(
        ...     builder,
        ...     arm_plant=MakePa10Plant(),
        ...     estimated_state=arm.get_state_output_port(),
        ...     feedforward_torque=controller.GetInputPort("feedforward_torque"),
        ... ).get_name()
        'gravity_compensation'
    """
    gravity_compensation = builder.AddSystem(
        InverseDynamics(arm_plant, InverseDynamics.InverseDynamicsMode.kGravityCompensation)
    )
    gravity_compensation.set_name(name)
    # Drake's system only points to the plant, which must live as long as the diagram does.
    gravity_compensation.arm_plant = arm_plant
    builder.Connect(estimated_state, gravity_compensation.get_input_port_estimated_state())
    builder.Connect(gravity_compensation.get_output_port_generalized_force(), feedforward_torque)
    return gravity_compensation


def AddComputedTorque(
    builder: DiagramBuilder,
    *,
    arm_plant: MultibodyPlant,
    estimated_state: OutputPort,
    desired_acceleration: OutputPort,
    feedforward_torque: InputPort,
    name: str = "computed_torque",
) -> InverseDynamics:
    """Adds the torques that an arm without errors needs, and connects them to a controller.

    They are those of the desired accelerations at the arm's present state, its weight included. A
    PD controller alone makes torques of errors only, so that the hand lags where it accelerates.

    Args:
        builder: The builder of the diagram.
        arm_plant: See `AddGravityCompensation`.
        estimated_state: The output port with the arm's state, of size 2n.
        desired_acceleration: The output port with the joints' desired accelerations, of size n.
        feedforward_torque: The controller's input port of that name, of size n.
        name: The system's name.

    Returns:
        Drake's own system, which computes the torques.

    Example:
        >>> import mffdrake as mff
        >>> from pydrake.systems.framework import DiagramBuilder
        >>> from pydrake.systems.primitives import ConstantVectorSource
        >>> builder = DiagramBuilder()
        >>> arm = builder.AddSystem(mff.MakePa10Plant(0.001))
        >>> wanted = builder.AddSystem(ConstantVectorSource(np.zeros(7)))
        >>> gains = mff.PdGains.LightlyDamped()
        >>> controller = builder.AddSystem(PdController(kp=gains.kp, kd=gains.kd))
        >>> AddComputedTorque(
        ...     builder,
        ...     arm_plant=mff.MakePa10Plant(),
        ...     estimated_state=arm.get_state_output_port(),
        ...     desired_acceleration=wanted.get_output_port(),
        ...     feedforward_torque=controller.GetInputPort("feedforward_torque"),
        ... ).get_name()
        'computed_torque'
    """
    system = builder.AddNamedSystem(
        name, InverseDynamics(arm_plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics)
    )
    # Drake's system only points to the plant, which must live as long as the diagram does.
    system.arm_plant = arm_plant
    builder.Connect(estimated_state, system.get_input_port_estimated_state())
    builder.Connect(desired_acceleration, system.get_input_port_desired_acceleration())
    builder.Connect(system.get_output_port_generalized_force(), feedforward_torque)
    return system


def _CheckVector(name: str, value: ArrayLike, n: int, finite: bool = True) -> NDArray[np.float64]:
    vector = np.array(value, dtype=float)
    if vector.shape != (n,):
        raise ValueError(f"PdController: {name} must have shape ({n},), not {vector.shape}")
    if np.any(np.isnan(vector)) or np.any(vector < 0.0) or (finite and np.any(np.isinf(vector))):
        raise ValueError(
            f"PdController: {name} must be {'finite and ' if finite else ''}not negative, "
            f"not {vector}"
        )
    return vector
