"""Smoothly from point to point."""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Annotated

import numpy as np
from annotated_types import MinLen
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.recognition.parameters import NonNegative, Position, Vector3, parameters, shown
from mffdrake.systems.target_motion.target_motion import Offset, OffsetMotion

__all__ = ["Waypoint", "Waypoints"]


_SOONEST = 1e-6  # s, from point to point


@parameters
class Waypoint:
    """Where a target is at a time.

    Attributes:
        time: The time [s].
        translation: How far it has moved along the world's axes [m].
        rotation_deg: The rotation vector by which it has turned, along them [deg].

    Example:
        >>> turned = Waypoint(time=4.0, rotation_deg=(0.0, 0.0, 90.0))
        >>> Waypoints(points=(Waypoint(time=0.0), turned)).CalcOffset(2.0)[1].round(3)
        array([0.   , 0.   , 0.785])
    """

    time: NonNegative
    translation: Position = (0.0, 0.0, 0.0)
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)


@parameters
class Waypoints(OffsetMotion):
    """The target moves from point to point, without passing beyond any, at rest before and after.

    Attributes:
        points: The points, in the order of their times.

    Raises:
        ValueError: When the times do not increase.

    Example:
        >>> there = Waypoints(points=(Waypoint(time=0), Waypoint(time=2, translation=(0.2, 0, 0))))
        >>> there.CalcOffset(1.0)[0]
        array([0.1, 0. , 0. ])
    """

    points: Annotated[tuple[Waypoint, ...], MinLen(1)] = (
        Waypoint(time=0.0),
        Waypoint(time=5.0, translation=(0.0, 0.1, 0.0)),
        Waypoint(time=10.0),
    )

    def __post_init__(self) -> None:
        """Checks the times."""
        times = [point.time for point in self.points]
        if any(later - time < _SOONEST for time, later in itertools.pairwise(times)):
            raise ValueError(
                f"points must be in the order of their times, at least {_SOONEST:g} s apart, not "
                f"at {shown(times)} s"
            )

    def CalcOffset(self, time: float) -> Offset:
        """See `OffsetMotion.CalcOffset`."""
        offset = self._trajectory.value(time).ravel()  # the nearest end's, before and after
        return offset[:3], np.radians(offset[3:])

    @cached_property
    def _trajectory(self) -> PiecewisePolynomial:
        times = np.array([point.time for point in self.points])
        values = np.array([[*point.translation, *point.rotation_deg] for point in self.points])
        if len(times) == 1:
            return PiecewisePolynomial(values.T)
        if len(times) == 2:  # Drake's shape-preserving splines need three.
            rest = np.zeros((6, 1))
            return PiecewisePolynomial.CubicHermite(times, values.T, np.hstack([rest, rest]))
        return PiecewisePolynomial.CubicShapePreserving(
            times, values.T, zero_end_point_derivatives=True
        )
