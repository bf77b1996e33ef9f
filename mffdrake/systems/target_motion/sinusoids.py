"""To and fro along and about any axes."""

from __future__ import annotations

import numpy as np

from mffdrake.recognition.parameters import Duration, Finite, Position, Vector3, parameters
from mffdrake.systems.target_motion.target_motion import Offset, OffsetMotion

__all__ = ["Sinusoids"]


@parameters
class Sinusoids(OffsetMotion):
    """Every coordinate is a sine of time: ``amplitude sin(2 pi t / period + phase)``.

    The coordinates are the place along the world's x, y and z, and the rotation vector about them.

    Attributes:
        amplitude: Of the place [m].
        amplitude_deg: Of the rotation vector [deg].
        period: Of all six coordinates [s]: one number for all, or six.
        phase_deg: Of all six coordinates [deg]: one number for all, or six.

    Raises:
        ValueError: When there are neither one nor six periods or phases.

    Example:
        >>> swing = Sinusoids(amplitude=(0, 0.15, 0), period=(10.0,))
        >>> swing.CalcOffset(2.5)[0]
        array([0.  , 0.15, 0.  ])
    """

    amplitude: Position = (0.0, 0.15, 0.0)
    amplitude_deg: Vector3 = (0.0, 0.0, 0.0)
    period: tuple[Duration, ...] = (10.0,)
    phase_deg: tuple[Finite, ...] = (0.0,)

    def __post_init__(self) -> None:
        """Checks how many there are."""
        for name in ("period", "phase_deg"):
            values = getattr(self, name)
            if len(values) not in (1, 6):
                raise ValueError(
                    f"{name} must be a list of one number or of six (x, y, z and the rotation "
                    f"about them), not of {len(values)}"
                )

    def CalcOffset(self, time: float) -> Offset:
        """See `OffsetMotion.CalcOffset`."""
        phases = 2.0 * np.pi * time / np.array(self.period) + np.radians(self.phase_deg)
        sines = np.broadcast_to(np.sin(phases), 6)
        return np.array(self.amplitude) * sines[:3], np.radians(self.amplitude_deg) * sines[3:]
