"""Random numbers that depend on a seed, on who asks and on the control tick, and nothing else."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

__all__ = ["RandomStream"]

_FIRST_KEY = 2**63 + 2**62
"""Keys apart from those of the recognizer (the frame's number) and of the encoders (2^63)."""


@dataclass(frozen=True)
class RandomStream:
    """The random numbers of one thing in a simulation.

    It has no state: asked twice for the same tick, it gives the same numbers.

    Attributes:
        seed: Of the simulation, from 0 to below 2^63.
        index: Number of the thing among those of its kind, from 0 to below 2^30.
        name: Tells things of one number apart, such as the cameras by their names.

    Example:
        >>> stream = RandomStream(seed=1, index=0, name="right")
        >>> stream.At(33).random() == stream.At(33).random()
        True
    """

    seed: int
    index: int
    name: str

    def At(self, tick: int) -> np.random.Generator:
        """The numbers of a control tick."""
        # The name's checksum, unlike its hash, is the same in all processes.
        key = _FIRST_KEY + (self.index << 32) + zlib.crc32(self.name.encode())
        bits = np.random.Philox(key=[self.seed, key], counter=[0, 0, 0, tick])
        return np.random.Generator(bits)
