"""Gains of the arm's joint controller: presets for the PA-10, natural frequencies for any arm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np

from mffdrake.recognition.parameters import NonNegative, OneOf, Positive, parameters
from mffdrake.systems.arms.arm_joints import JointNames, MovingJoints
from mffdrake.systems.arms.pa10 import JOINT_NAMES
from mffdrake.systems.timing import Timing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

__all__ = ["PD_GAINS", "Gains", "LightlyDamped", "NaturalFrequency", "PdGains", "WellDamped"]

_LEAST_INERTIA = 0.01  # Share of the arm's largest inertia that every joint's gains are made for.


@dataclass(frozen=True, kw_only=True)
class PdGains:
    """Gains of the arm's PD controller, one number a joint from base to tip.

    Both presets are the PA-10's: ``kp = M w^2`` and ``kd = 2 zeta w M``, rounded. M = (2.95, 4.09,
    1.09, 1.07, 0.04, 0.04, 0.02) kg m^2 stands for the diagonal of the arm's mass matrix at its
    nominal pose; the wrist's values are raised, for its own (0.020, 0.014, 0.006) would leave it
    too soft. For any other arm see :meth:`FromNaturalFrequency`.

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
    def FromNaturalFrequency(
        cls,
        plant: MultibodyPlant,
        *,
        positions: ArrayLike,
        frequency_hz: float,
        damping_ratio: float,
        model_instance: ModelInstanceIndex | None = None,
    ) -> PdGains:
        """Gains with which each joint alone would swing at one frequency: any arm's.

        ``kp = M w^2`` and ``kd = 2 zeta w M`` with ``w = 2 pi frequency_hz``. M is the diagonal of
        the mass matrix, reflected rotor inertias included. Inertias below 1 % of the largest are
        raised to that, as in the presets: the wrist alone is so light that with its own inertia it
        would give way to the forces that the rest of the arm and the cameras exert on it. As the
        joints are coupled, the slowest mode swings at less than ``frequency_hz``.

        Args:
            plant: A finalized plant with the arm.
            positions: The arm's posture [rad, or m where a joint slides], shape (n,).
            frequency_hz: Natural frequency of each joint [Hz], positive.
            damping_ratio: Share of critical damping, at least 0.
            model_instance: The arm; by default all that moves in the plant.

        Returns:
            The gains, in the order of the positions.

        Raises:
            ValueError: If ``positions`` does not fit the arm.

        Example:
            >>> from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
            >>> gains = PdGains.FromNaturalFrequency(
            ...     MakePa10Plant(), positions=NOMINAL_POSITIONS, frequency_hz=1, damping_ratio=0.1
            ... )
            >>> np.round(gains.kp, 1)
            array([116.6, 161.6,  43. ,  42.1,   1.6,   1.6,   1.6])
        """
        joints = MovingJoints(plant, model_instance)
        q = np.array(positions, dtype=float)
        if q.shape != (len(joints),):
            raise ValueError(
                f"PdGains: positions must have shape ({len(joints)},), one number for each of "
                f"{JointNames(joints)}, not {q.shape}"
            )
        context = plant.CreateDefaultContext()
        all_positions = plant.GetPositions(context)
        all_positions[[joint.position_start() for joint in joints]] = q
        plant.SetPositions(context, all_positions)
        inertias = np.diag(plant.CalcMassMatrix(context))[
            [joint.velocity_start() for joint in joints]
        ]
        M = np.maximum(inertias, _LEAST_INERTIA * np.max(inertias))
        w = 2.0 * np.pi * frequency_hz
        return cls(kp=tuple((M * w**2).tolist()), kd=tuple((2.0 * damping_ratio * w * M).tolist()))

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


@parameters
class NaturalFrequency:
    """Gains by what they do, for any arm: how fast each joint swings, and how soon it calms down.

    The zero-order hold and its delay of one control period T take ``kp T`` off the damping ``kd``:
    of the damping ratio, ``pi frequency_hz T``. What is left must be positive, or the arm swings
    more and more.

    Attributes:
        frequency_hz: Natural frequency of each joint alone [Hz].
        damping_ratio: Share of critical damping: at 1 a joint does not swing.

    Example:
        >>> from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
        >>> gains = NaturalFrequency(frequency_hz=3).MakeGains(
        ...     MakePa10Plant(), positions=NOMINAL_POSITIONS
        ... )
        >>> np.round(gains.kd)
        array([111., 154.,  41.,  40.,   2.,   2.,   2.])
    """

    frequency_hz: Positive = 1.0
    damping_ratio: NonNegative = 1.0

    def MakeGains(
        self,
        plant: MultibodyPlant,
        *,
        positions: ArrayLike,
        model_instance: ModelInstanceIndex | None = None,
        timing: Timing | None = None,
    ) -> PdGains:
        """The gains of an arm in a posture; see :meth:`PdGains.FromNaturalFrequency`.

        Args:
            plant: A finalized plant with the arm.
            positions: The arm's posture [rad, or m where a joint slides], shape (n,).
            model_instance: The arm; by default all that moves in the plant.
            timing: Gives the control period; 1 ms by default.

        Returns:
            The gains, in the order of the positions.

        Raises:
            ValueError: If ``positions`` does not fit the arm, or the hold would take all damping.
        """
        period = (timing or Timing()).control_period
        lost = math.pi * self.frequency_hz * period
        if self.damping_ratio <= lost:
            raise ValueError(
                f"NaturalFrequency: damping_ratio must be above {lost:.3g}, not "
                f"{self.damping_ratio:g}: at {self.frequency_hz:g} Hz the controller's hold of "
                f"{1e3 * period:g} ms takes that much off it. Raise it, or reduce frequency_hz."
            )
        return PdGains.FromNaturalFrequency(
            plant,
            positions=positions,
            frequency_hz=self.frequency_hz,
            damping_ratio=self.damping_ratio,
            model_instance=model_instance,
        )


class _Preset:
    """The PA-10's rounded numbers; for any other arm what they stand for."""

    name: str
    design: NaturalFrequency

    def MakeGains(
        self,
        plant: MultibodyPlant,
        *,
        positions: ArrayLike,
        model_instance: ModelInstanceIndex | None = None,
        timing: Timing | None = None,
    ) -> PdGains:
        """The gains of an arm in a posture; see `NaturalFrequency.MakeGains`."""
        names = [joint.name() for joint in MovingJoints(plant, model_instance)]
        if tuple(names) == JOINT_NAMES:
            return PD_GAINS[self.name]
        return self.design.MakeGains(
            plant, positions=positions, model_instance=model_instance, timing=timing
        )


@parameters
class LightlyDamped(_Preset):
    """The paper's Fig. 6, in which the hand visibly oscillates; see `PdGains.LightlyDamped`."""

    name = "lightly_damped"
    design = NaturalFrequency(frequency_hz=1.0, damping_ratio=0.018)


@parameters
class WellDamped(_Preset):
    """A good controller; see `PdGains.WellDamped`."""

    name = "well_damped"
    design = NaturalFrequency(frequency_hz=3.0, damping_ratio=1.0)


Gains: TypeAlias = Annotated[LightlyDamped | WellDamped | NaturalFrequency, OneOf()]
"""A parameter that says how stiff and how damped the joints are."""
