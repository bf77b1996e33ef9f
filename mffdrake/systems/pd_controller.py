"""The arm's joint controller: PD with a zero-order hold, its gains, and gravity compensation."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import BasicVector, LeafSystem

from mffdrake.systems.timing import Timing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.framework import (
        Context,
        DiagramBuilder,
        DiscreteValues,
        InputPort,
        OutputPort,
    )

__all__ = ["PD_GAINS", "AddGravityCompensation", "PdController", "PdGains"]


@dataclass(frozen=True, kw_only=True)
class PdGains:
    """Gains of the arm's PD controller, one number a joint in the order of ``JOINT_NAMES``.

    Both presets are ``kp = M w^2`` and ``kd = 2 zeta w M``, rounded. M = (2.95, 4.09, 1.09, 1.07,
    0.04, 0.04, 0.02) kg m^2 stands for the diagonal of the arm's mass matrix at its nominal pose;
    the wrist's values are raised, for its own (0.020, 0.014, 0.006) would leave it too soft.

    Attributes:
        kp: Stiffness [N m/rad].
        kd: Damping [N m s/rad].

    Example:
        >>> PdGains.FromPreset("lightly_damped").kp
        (116.0, 161.0, 43.0, 42.0, 1.6, 1.6, 0.8)
    """

    kp: tuple[float, ...]
    kd: tuple[float, ...]

    @classmethod
    def LightlyDamped(cls) -> PdGains:
        """The paper's Fig. 6: the hand visibly oscillates for the first 30 s. The default.

        w = 2 pi 1.0 rad/s and zeta = 0.018. The zero-order hold and its delay of one control
        period (1 ms) take ``kp`` times 1 ms off the damping, a sixth of it.

        Measured with gravity compensation and effort limits, starting at rest in the path's first
        pose while the path starts at full speed; the hand's distance from the desired position:

        =============  ==========  ============  ============  ===========  ===========
        path's omega   peak 0-5 s  peak 10-15 s  peak 30-35 s  rms 10-15 s  rms 30-40 s
        =============  ==========  ============  ============  ===========  ===========
        0.105 rad/s    10.3 mm     5.3 mm        1.9 mm        3.2 mm       1.0 mm
        0.157 rad/s    15.3 mm     7.9 mm        2.8 mm        4.9 mm       1.5 mm
        0.314 rad/s    30.6 mm     16.3 mm       6.0 mm        10.0 mm      3.2 mm
        =============  ==========  ============  ============  ===========  ===========

        At 0.105 rad/s the hand's direction is off by up to 1.1 deg at first, 0.35 deg after 10 s
        and 0.13 deg after 30 s. The joints are coupled: the slowest mode, S1 with S3, swings at
        0.75 Hz and lasts longest.
        """
        return PD_GAINS["lightly_damped"]

    @classmethod
    def WellDamped(cls) -> PdGains:
        """A good controller: the hand follows the path within 0.1 mm from 0.5 s on.

        w = 2 pi 3.0 rad/s and zeta = 1. Measured as above, at 0.105 rad/s: 1.2 mm at first and
        0.02 mm later; at 1.3 rad/s 15 mm at first and 2.6 mm later.
        """
        return PD_GAINS["well_damped"]

    @classmethod
    def FromPreset(cls, name: str) -> PdGains:
        """Gains by the name of a preset.

        Args:
            name: ``lightly_damped`` or ``well_damped``.

        Returns:
            The gains.

        Raises:
            ValueError: If there is no such preset; the message lists the names.
        """
        if name not in PD_GAINS:
            raise ValueError(f"unknown PD gains '{name}'; known presets: {', '.join(PD_GAINS)}")
        return PD_GAINS[name]


PD_GAINS: Mapping[str, PdGains] = MappingProxyType(
    {
        "lightly_damped": PdGains(
            kp=(116.0, 161.0, 43.0, 42.0, 1.6, 1.6, 0.8),
            kd=(0.667, 0.925, 0.247, 0.242, 0.0091, 0.0091, 0.0045),
        ),
        "well_damped": PdGains(
            kp=(1050.0, 1450.0, 390.0, 380.0, 14.0, 14.0, 7.1),
            kd=(111.0, 154.0, 41.0, 40.0, 1.5, 1.5, 0.75),
        ),
    }
)
"""The presets of :class:`PdGains` by name."""


class PdController(LeafSystem):
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
        LeafSystem.__init__(self)
        n = np.size(kp)
        if n == 0:
            raise ValueError("PdController: kp must have one number a joint, but is empty")
        kp, kd = _CheckVector("kp", kp, n), _CheckVector("kd", kd, n)
        upper = np.full(n, np.inf)
        if effort_limit is not None:
            upper = _CheckVector("effort_limit", effort_limit, n, finite=False)
            if np.any(upper == 0.0):
                raise ValueError(f"PdController: effort_limit must be positive, not {upper}")
        self._gains = np.hstack((np.diag(kp), np.diag(kd)))
        self._lower, self._upper = -upper, upper

        self._estimated_state = self.DeclareVectorInputPort("estimated_state", BasicVector(2 * n))
        self._desired_state = self.DeclareVectorInputPort("desired_state", BasicVector(2 * n))
        self._feedforward = self.DeclareVectorInputPort("feedforward_torque", BasicVector(n))
        self.DeclareStateOutputPort("actuation", self.DeclareDiscreteState(n))

        period = (timing or Timing()).control_period
        self.DeclareInitializationDiscreteUpdateEvent(self._UpdateActuation)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._UpdateActuation)
        self.DeclareForcedDiscreteUpdateEvent(self._UpdateActuation)

    def _UpdateActuation(self, context: Context, discrete_state: DiscreteValues) -> None:
        # This runs every millisecond: 6 us, most of them for the ports.
        torque = self._gains @ (
            self._desired_state.Eval(context) - self._estimated_state.Eval(context)
        )
        if self._feedforward.HasValue(context):
            torque += self._feedforward.Eval(context)
        discrete_state.set_value(np.minimum(np.maximum(torque, self._lower), self._upper))


def AddGravityCompensation(
    builder: DiagramBuilder,
    *,
    arm_plant: MultibodyPlant,
    estimated_state: OutputPort,
    feedforward_torque: InputPort,
    name: str = "gravity_compensation",
) -> InverseDynamics:
    """Adds the torques that carry the arm's weight, and connects them to a controller.

    Without them, the soft gains of :meth:`PdGains.LightlyDamped` let joint S2 give way by 20 deg
    under the weight of the arm alone.

    Args:
        builder: The builder of the diagram.
        arm_plant: The controller's model of the arm alone, with the n joints of the controller;
            see :func:`~mffdrake.systems.pa10.MakePa10Plant`.
        estimated_state: The output port with the arm's state, of size 2n.
        feedforward_torque: The controller's input port of that name, of size n.
        name: The system's name.

    Returns:
        Drake's own system, which computes the torques where gravity's are balanced.

    Example:
        >>> from mffdrake.systems.pa10 import MakePa10Plant
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
