"""Small random motions of a pose, along the directions that a stereo match confuses.

Independent steps of the six coordinates seldom improve a nearly right pose, because the errors of a
nearly right match are coupled: a solid that is too near must move along the line of sight and
sideways at once to stay matched in both images, and one that is tilted wrongly was turned about
the face that still matches, not about its center. These moves follow that geometry: they turn the
solid about one of its face centers, move it along the line of sight of the middle between the
cameras, and shift it.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Le, Lt
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.parameters import Finite, NonNegative, parameters

if TYPE_CHECKING:
    from mffdrake.recognition.genetic.breeding import Moves

Array = NDArray[np.float64]


@parameters
class LocalMoveParameters:
    """How far the moves go.

    Attributes:
        depth: Standard deviation of the motion along the line of sight [m].
        shift: Standard deviation of the shift along each axis [m].
        rotation_deg: Standard deviation of the rotation about each axis [deg].
        decades: Every move has a size of its own, by a factor spread evenly in the logarithm over
            so many decades below one: there are always some large and some small moves.
        sparsity: Chance of each of a move's seven components to be left out.

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> small = LocalMoveParameters(depth=0.02, shift=0.01, rotation_deg=5.0)
        >>> moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), small)
        >>> poses = moves.draw([0.0, 0.0, 0.8, 0.0, 0.0, 0.0], 100, np.random.default_rng(0))
        >>> bool((abs(poses[:, 2] - 0.8) < 0.1).all())
        True
    """

    depth: Annotated[Finite, Ge(0), Le(1e3)] = 0.200
    shift: Annotated[Finite, Ge(0), Le(1e3)] = 0.040
    rotation_deg: NonNegative = 34.0
    decades: Annotated[Finite, Ge(0), Le(100)] = 2.0
    sparsity: Annotated[Finite, Ge(0), Lt(1)] = 0.5


class LocalMoves:
    """Draws poses around a given one.

    Args:
        pivots: Points of the solid in its frame M [m] about which it is turned, shape (K, 3).
        middle: The point of the frame C in the middle of the cameras [m], shape (3,).
        parameters: How far the moves go.

    Example:
        >>> moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), LocalMoveParameters())
        >>> moves.draw([0.0, 0.155, 0.8, 0.0, 0.0, 0.0], 5, np.random.default_rng(0)).shape
        (5, 6)
    """

    def __init__(
        self, pivots: ArrayLike, middle: ArrayLike, parameters: LocalMoveParameters
    ) -> None:
        self.pivots: Array = np.asarray(pivots, dtype=float).reshape(-1, 3)
        self.middle: Array = np.asarray(middle, dtype=float)
        self.parameters = parameters

    @cached_property
    def struct(self) -> Moves:
        """What the compiled functions take."""
        from mffdrake.recognition.genetic.breeding import Moves  # numba: slow to import

        p = self.parameters
        return Moves(
            self.pivots, self.middle, float(p.depth), float(p.shift),
            math.radians(p.rotation_deg), float(p.decades), float(p.sparsity),
        )  # fmt: skip

    def draw(self, pose: ArrayLike, count: int, rng: np.random.Generator) -> Array:
        """Poses around one.

        Args:
            pose: Pose vector, shape (6,).
            count: How many.
            rng: Source of randomness.

        Returns:
            Pose vectors, shape (count, 6).
        """
        from mffdrake.recognition.genetic import breeding, random_numbers  # numba: slow to import

        poses: Array = breeding.draw_local_moves(
            np.array(pose, dtype=float), count, self.struct, random_numbers.address_of(rng)
        )
        return poses
