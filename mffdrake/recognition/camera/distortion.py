"""How lenses bend what a pinhole would show: OpenCV's and ROS's models."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mffdrake.recognition.parameters import Finite, check_fields

__all__ = ["MODELS", "Distortion"]

MODELS = ("none", "plumb_bob", "equidistant")  # as `lens` numbers them
_COUNTS = {"none": (0,), "plumb_bob": (4, 5, 8), "equidistant": (4,)}


@dataclass(frozen=True)
class Distortion:
    """How a lens bends what a pinhole would show.

    Attributes:
        model: "none"; "plumb_bob", OpenCV's and ROS's polynomial model, rational with eight
            coefficients; or "equidistant", OpenCV's fisheye.
        coefficients: k1, k2, p1, p2 and, of five, k3 and, of eight, k4, k5, k6 for "plumb_bob"; k1
            to k4 for "equidistant".

    Raises:
        ValueError: When the model is unknown or has another number of coefficients.

    Example:
        >>> Distortion("plumb_bob", (-0.2, 0.1, 0.0, 0.0)).max_radius
        inf
    """

    model: Literal["none", "plumb_bob", "equidistant"] = "none"
    coefficients: tuple[Finite, ...] = ()

    def __post_init__(self) -> None:
        """Checks the model and the coefficients."""
        check_fields(self, "distortion: ")
        count = len(self.coefficients)
        if count not in _COUNTS[self.model]:
            wanted = " or ".join(map(str, _COUNTS[self.model]))
            raise ValueError(f"distortion: {self.model} has {wanted} coefficients, not {count}")

    @property
    def max_radius(self) -> float:
        """Normalized distance from the axis up to which the image grows with the distance.

        Beyond it a polynomial folds back into the image what no lens shows there.
        """
        k = np.zeros(8)
        k[: len(self.coefficients)] = self.coefficients
        if self.model == "plumb_bob":  # in s = r^2, the highest power first, as np.poly1d has it
            top, bottom = np.poly1d([k[4], k[1], k[0], 1.0]), np.poly1d([k[7], k[6], k[5], 1.0])
            # The derivative of r top / bottom, times bottom^2; and where the bottom vanishes
            s = np.poly1d([1.0, 0.0])
            slope = top * bottom + 2.0 * s * (top.deriv() * bottom - top * bottom.deriv())
            return math.sqrt(min(_least_positive(slope), _least_positive(bottom)))
        if self.model == "equidistant":
            slope = np.poly1d([9.0 * k[3], 7.0 * k[2], 5.0 * k[1], 3.0 * k[0], 1.0])
            return math.tan(min(math.sqrt(_least_positive(slope)), math.radians(89.0)))
        return math.inf


def _least_positive(polynomial: np.poly1d) -> float:
    """The least positive root, or infinity."""
    # The roots are found by a division by the first coefficient, which must not overflow.
    coefficients = np.where(np.abs(polynomial.coeffs) < 1e-100, 0.0, polynomial.coeffs)
    roots = [
        r.real
        for r in np.atleast_1d(np.poly1d(coefficients).roots)
        if abs(r.imag) < 1e-9 and r.real > 0
    ]
    return float(min(roots, default=math.inf))
