"""Which pixels show which color of a solid.

A `ColorModel` accepts a pixel as a color when its hue lies near that color's mean hue, nearer than
to any other's, and it is bright and colorful enough to have a hue. For the compiled functions it
becomes a look-up table over the upper bits of the three channels, one bit a color.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.parameters import Finite, Share, check_fields

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import ColorGate

Array = NDArray[np.float64]
Bits = NDArray[np.uint32]

_BITS = 6  # of each channel in the look-up table
_MOST_COLORS = 32
_LEAST_TOLERANCE = math.radians(5.0)
_LEAST_CUT = math.radians(15.0)
_LEAST_PIXELS = 20

ChannelOrder = Literal["rgb", "bgr"]


@dataclass(frozen=True)
class FaceColor:
    """How one color of a solid looks.

    Attributes:
        name: Its material's name in the mesh file.
        hue: Mean hue [rad].
        tolerance: Greatest difference of hue [rad], from 0 to pi.

    Raises:
        ValueError: When a number is outside its range.

    Example:
        >>> FaceColor("leaf", math.radians(120.0), math.radians(15.0)).name
        'leaf'
    """

    name: str
    hue: Finite
    tolerance: float

    def __post_init__(self) -> None:
        """Checks the numbers and brings the hue to [0, 2 pi)."""
        check_fields(self, f"color '{self.name}': ")
        if not 0.0 <= self.tolerance <= math.pi:
            raise ValueError(
                f"color '{self.name}': the hue's tolerance must be between 0 and 180 deg, not "
                f"{math.degrees(self.tolerance):g}"
            )
        object.__setattr__(self, "hue", self.hue % (2.0 * math.pi))


@dataclass(frozen=True, kw_only=True)
class ColorModel:
    """Which pixels show which color of a solid.

    Attributes:
        colors: The solid's colors.
        min_saturation: Least saturation (0 to 1) of a pixel that has a hue; grey has none.
        min_value: Least value, i.e. brightness (0 to 1), of such a pixel.
        min_chroma: Least chroma (0 to 1), which is saturation times value, of such a pixel: in the
            dark, little noise makes much saturation.

    Raises:
        ValueError: When a number is outside its range, names repeat, or there are no colors or too
            many.

    Example:
        >>> model = ColorModel(colors=(FaceColor("red", 0.0, 0.3), FaceColor("green", 2.1, 0.3)))
        >>> model.classify([[250, 10, 10], [10, 200, 10], [90, 90, 90]])   # one bit a color
        array([1, 2, 0], dtype=uint32)
    """

    colors: tuple[FaceColor, ...]
    min_saturation: Share = 0.28
    min_value: Share = 0.15
    min_chroma: Share = 0.09

    def __post_init__(self) -> None:
        """Checks the numbers."""
        object.__setattr__(self, "colors", tuple(self.colors))
        if not 1 <= len(self.colors) <= _MOST_COLORS:
            count = len(self.colors)
            raise ValueError(f"a solid must have from 1 to {_MOST_COLORS} colors, not {count}")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"colors must have different names, not {list(self.names)}")
        check_fields(self)

    @property
    def names(self) -> tuple[str, ...]:
        """The colors' names."""
        return tuple(color.name for color in self.colors)

    def classify(self, pixels: ArrayLike) -> Bits:
        """The colors that pixels show.

        Args:
            pixels: RGB, from 0 to 255, shape (..., 3 or more).

        Returns:
            Of each pixel the sum of ``2**k`` over the colors k it shows, shape (...). That is one
            color or none, but where two can hardly be told apart.
        """
        rgb = np.asarray(pixels, dtype=float)[..., :3]
        hue, chroma, value = hue_chroma_value(rgb)
        colorful = (
            (chroma > 0.0)
            & (chroma >= self.min_saturation * value)
            & (value >= self.min_value)
            & (chroma >= self.min_chroma)
        )
        away = np.abs(around_circle(hue[..., None] - self._hues))
        nearest = np.argmin(away, axis=-1)
        # The last bit of a degree must not decide.
        shown = (away <= self._tolerances + 1e-9) & self._same[nearest] & colorful[..., None]
        bits = np.left_shift(np.uint32(1), np.arange(len(self.colors), dtype=np.uint32))
        return np.asarray((shown * bits).sum(axis=-1), dtype=np.uint32)

    def overlaps(self) -> list[tuple[str, str]]:
        """The pairs of colors of which some pixels could show either."""
        pairs = itertools.combinations(range(len(self.colors)), 2)
        return [(self.names[i], self.names[j]) for i, j in pairs if self._alike[i, j]]

    @cached_property
    def _hues(self) -> Array:
        return np.array([color.hue for color in self.colors])

    @cached_property
    def _tolerances(self) -> Array:
        return np.array([color.tolerance for color in self.colors])

    @cached_property
    def _apart(self) -> Array:
        """Differences of the mean hues, shape (C, C)."""
        return np.abs(around_circle(self._hues[:, None] - self._hues))

    @cached_property
    def _alike(self) -> NDArray[np.bool_]:
        """Whether the hues that two colors accept overlap, shape (C, C)."""
        return np.asarray(self._apart <= self._tolerances[:, None] + self._tolerances)

    @cached_property
    def _same(self) -> NDArray[np.bool_]:
        """Whether two colors cannot be told apart: then both are shown, shape (C, C)."""
        least = np.minimum(self._tolerances[:, None], self._tolerances)
        return np.asarray(self._apart <= 0.5 * least)

    def bits_of(self, materials: Sequence[str]) -> Bits:
        """The bit of each of some materials.

        Args:
            materials: Names of colors of this model.

        Returns:
            Numbers ``2**k``, shape (number of materials,).

        Raises:
            ValueError: When a material has no color here.
        """
        return np.array([1 << k for k in self._indices(materials)], dtype=np.uint32)

    def alike(self, materials: Sequence[str]) -> NDArray[np.bool_]:
        """Whether the colors of each two of some materials overlap.

        Args:
            materials: Names of colors of this model.

        Returns:
            A symmetric matrix, shape (number of materials, number of materials).

        Raises:
            ValueError: When a material has no color here.
        """
        k = self._indices(materials)
        return np.ascontiguousarray(self._alike[np.ix_(k, k)])

    def first_alike(self, materials: Sequence[str]) -> NDArray[np.int64]:
        """Of each of some materials the first color that it cannot be told from.

        Args:
            materials: Names of colors of this model.

        Returns:
            Numbers of colors, shape (number of materials,).

        Raises:
            ValueError: When a material has no color here.
        """
        return np.asarray(np.argmax(self._same, axis=1)[self._indices(materials)])

    def _indices(self, materials: Sequence[str]) -> list[int]:
        missing = sorted(set(materials) - set(self.names))
        if missing:
            raise ValueError(
                f"no color for the solid's material{'s' * (len(missing) > 1)} "
                f"{', '.join(missing)}; there are colors for {', '.join(self.names)}"
            )
        return [self.names.index(material) for material in materials]

    def gate(
        self, *, channel_order: ChannelOrder = "rgb", gains: ArrayLike = (1.0, 1.0, 1.0)
    ) -> ColorGate:
        """What the compiled functions take: the look-up table.

        Args:
            channel_order: Of the pixels that will be looked up.
            gains: White balance: what red, green and blue are multiplied with before, shape (3,).

        Raises:
            ValueError: When they are not positive.
        """
        from mffdrake.recognition.fitness.structs import ColorGate  # numba: slow to import

        factors = np.asarray(gains, dtype=float)
        if factors.shape != (3,) or not ((factors > 0.0) & np.isfinite(factors)).all():
            raise ValueError(f"gains must be three positive numbers, not {gains!r}")
        values = np.rint(np.arange(256) * np.minimum(factors, 1e6)[:, None])
        upper = np.clip(values, 0, 255).astype(np.uint32) >> (8 - _BITS)
        places = upper << np.array([[2 * _BITS], [_BITS], [0]], dtype=np.uint32)
        if channel_order == "bgr":
            places = places[::-1]
        return ColorGate(np.ascontiguousarray(places), _table(self))

    @classmethod
    def of_hues(cls, hues: Mapping[str, float], *, tolerance: float, **gates: float) -> ColorModel:
        """Colors of known hues, with one tolerance for all.

        Args:
            hues: Material to hue [rad].
            tolerance: Greatest difference of hue [rad].
            **gates: ``min_saturation``, ``min_value``, ``min_chroma``.
        """
        colors = (FaceColor(name, hue, tolerance) for name, hue in hues.items())
        return cls(colors=tuple(colors), **gates)


@lru_cache(maxsize=8)
def _table(model: ColorModel) -> Bits:
    """The colors that every cell of the look-up table shows: those of its middle."""
    step = 1 << (8 - _BITS)
    middles = np.arange(1 << _BITS) * step + 0.5 * (step - 1)
    cells = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1)
    return model.classify(cells).reshape(-1)


def hue_chroma_value(rgb: ArrayLike) -> tuple[Array, Array, Array]:
    """Hue, chroma and value of the hexagonal HSV model.

    Args:
        rgb: Red, green, blue from 0 to 255, shape (..., 3).

    Returns:
        Hue [rad] in [0, 2 pi), zero where there is none; chroma and value from 0 to 1; each of
        shape (...).

    Example:
        >>> [float(x) for x in hue_chroma_value([0, 255, 0])]
        [2.0943951023931953, 1.0, 1.0]
    """
    rgb = np.asarray(rgb, dtype=float)
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    high = rgb.max(axis=-1)
    chroma = high - rgb.min(axis=-1)
    divisor = np.where(chroma > 0.0, chroma, 1.0)
    sixths = np.where(
        high == r, (g - b) / divisor,
        np.where(high == g, 2.0 + (b - r) / divisor, 4.0 + (r - g) / divisor),
    )  # fmt: skip
    return np.remainder(sixths, 6.0) * (math.pi / 3.0), chroma / 255.0, high / 255.0


def around_circle(angle: ArrayLike) -> Array:
    """Differences of hues, brought to the shorter way around the color circle.

    Args:
        angle: Angles [rad], any shape.

    Returns:
        The same angles in [-pi, pi), of the same shape.

    Example:
        >>> float(around_circle(1.5 * math.pi)) == -0.5 * math.pi
        True
    """
    shifted = np.asarray(angle, dtype=float) + math.pi
    return np.asarray(np.remainder(shifted, 2.0 * math.pi) - math.pi)


def learn_color(name: str, pixels: ArrayLike, gates: ColorModel) -> FaceColor:
    """Mean hue and spread of a face's pixels.

    Both are robust: a fifth of the pixels may belong to something else.

    Args:
        name: The material's name.
        pixels: RGB, from 0 to 255, shape (N, 3 or more).
        gates: Its least saturation, value and chroma decide which pixels count.

    Returns:
        The color, with three standard deviations as tolerance, at least 5 deg.

    Raises:
        ValueError: When fewer than 20 pixels are bright and colorful enough.

    Example:
        >>> gates = ColorModel(colors=(FaceColor("any", 0.0, 0.1),))
        >>> learned = learn_color("leaf", np.tile([20, 200, 20], (50, 1)), gates)
        >>> round(math.degrees(learned.hue)), round(math.degrees(learned.tolerance))
        (120, 5)
    """
    hue, chroma, value = hue_chroma_value(np.asarray(pixels)[..., :3].reshape(-1, 3))
    counts = (
        (chroma >= gates.min_saturation * value)
        & (value >= gates.min_value)
        & (chroma >= gates.min_chroma)
        & (chroma > 0.0)
    )
    if counts.sum() < _LEAST_PIXELS:
        raise ValueError(
            f"color '{name}': only {counts.sum()} of {len(hue)} pixels are bright and colorful "
            f"enough to have a hue; at least {_LEAST_PIXELS} are needed"
        )
    hue = hue[counts]
    mean = float(np.angle(np.exp(1j * hue).mean()))
    for _ in range(10):
        away = around_circle(hue - mean)
        middle = float(np.median(away))
        # Most pixels of a saturated face may have one hue and some another: no cut below 15 deg.
        cut = max(4.0 * 1.4826 * float(np.median(np.abs(away - middle))), _LEAST_CUT)
        kept = away[np.abs(away - middle) <= cut]
        mean += float(kept.mean())
    return FaceColor(name, mean, min(math.pi, max(3.0 * float(kept.std()), _LEAST_TOLERANCE)))
