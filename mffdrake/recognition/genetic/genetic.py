"""Genes and one generation of the genetic algorithm: equations (23)-(28).

A pose hypothesis is a string of six genes, one for each coordinate of the pose vector. The
algorithm is ask and tell: `GeneticAlgorithm.breed` turns a scored population into the next one,
which the caller scores on the next picture.
"""

from __future__ import annotations

from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.genetic.local_moves import LocalMoves
from mffdrake.recognition.parameters import Coordinate, Interval, Share, parameters

if TYPE_CHECKING:
    from mffdrake.recognition.camera.cameras import Camera, CameraRig
    from mffdrake.recognition.genetic.breeding import Coding, Shares

Array = NDArray[np.float64]
Bits = NDArray[np.uint8]

POSE_COORDINATES = ("x", "y", "z", "eps1", "eps2", "eps3")
"""Names of a pose vector's components, in their order."""

# What a target fills of an image's smaller side at the least and the greatest depth that a rig
# sees it in: it must be in the image as a whole, and its edges long enough to be told.
_NEAREST, _FARTHEST = 0.9, 0.1
_STEPS = 9  # along each side of an image, and in depth


@parameters
class SearchRange:
    """The box of poses which the genes span, as (least, greatest) of every coordinate.

    Attributes:
        x: Target's position in the rig's frame [m]; for the stereo pair to the right.
        y: For the stereo pair downward [m].
        z: For the stereo pair along the line of sight [m].
        eps1: First component of its quaternion's vector part.
        eps2: Second component.
        eps3: Third component.

    Raises:
        ValueError: When a coordinate's bounds are not in order, or the quaternion's components
            leave [-1, 1].

    Example:
        >>> SearchRange(x=(-0.2, 0.2)).lower
        array([-0.2 ,  0.  ,  0.65, -0.5 , -0.5 , -0.5 ])
    """

    x: tuple[Coordinate, Coordinate] = (-0.150, 0.150)
    y: tuple[Coordinate, Coordinate] = (0.0, 0.300)
    z: tuple[Coordinate, Coordinate] = (0.650, 0.950)
    eps1: Interval = (-0.5, 0.5)
    eps2: Interval = (-0.5, 0.5)
    eps3: Interval = (-0.5, 0.5)

    def __post_init__(self) -> None:
        """Checks the bounds."""
        for name in POSE_COORDINATES:
            bounds = getattr(self, name)
            if not bounds[0] < bounds[1]:
                raise ValueError(f"{name} must be [least, greatest], not {list(bounds)}")
            if name.startswith("eps") and (min(bounds) < -1 or max(bounds) > 1):
                raise ValueError(f"{name} must lie within [-1, 1], not {list(bounds)}")

    @classmethod
    def in_view(cls, rig: CameraRig, size: float) -> SearchRange:
        """All poses in which a camera can see a target well.

        Args:
            rig: The cameras.
            size: The target's greatest extent [m], `SolidModel.size`.

        Returns:
            The box around the places where the target's middle is in an image and it fills a
            tenth to nine tenths of its smaller side, in any orientation.

        Example:
            >>> from mffdrake.recognition import CameraRig
            >>> tuple(round(z, 2) for z in SearchRange.in_view(CameraRig.stereo(), 0.27).z)
            (0.36, 3.26)
        """
        places = np.concatenate([_seen_places(camera, size) for camera in rig.cameras])
        lower, upper = places.min(axis=0), places.max(axis=0)
        x, y, z = zip(lower.tolist(), upper.tolist(), strict=True)
        anyhow = (-1.0, 1.0)
        return cls(x=x, y=y, z=z, eps1=anyhow, eps2=anyhow, eps3=anyhow)

    @property
    def lower(self) -> Array:
        """Least pose vector, shape (6,)."""
        return np.array([getattr(self, name)[0] for name in POSE_COORDINATES], dtype=float)

    @property
    def upper(self) -> Array:
        """Greatest pose vector, shape (6,)."""
        return np.array([getattr(self, name)[1] for name in POSE_COORDINATES], dtype=float)


def _seen_places(camera: Camera, size: float) -> Array:
    """Places in the rig's frame, from all over what a camera sees of a target, shape (N, 3)."""
    focal = min(camera.fx, camera.fy)
    nearest, farthest = (
        focal * size / (share * min(camera.width, camera.height)) for share in (_NEAREST, _FARTHEST)
    )
    u = np.linspace(0.0, camera.width - 1.0, _STEPS)
    v = np.linspace(0.0, camera.height - 1.0, _STEPS)
    z = np.geomspace(nearest, farthest, _STEPS)
    u, v, z = (axis.ravel() for axis in np.meshgrid(u, v, z))
    p_K = np.column_stack([z * (u - camera.cx) / camera.fx, z * (v - camera.cy) / camera.fy, z])
    return p_K @ camera.R_CK.T + camera.p_CK


@parameters
class GeneCoding:
    """Pose vectors as strings of bits, six genes of equal length.

    Attributes:
        search_range: The poses which the genes span; others are moved to its border.
        bits: Bits a gene.
        coding: "binary" (the paper's), or "gray": neighboring values differ in one bit.

    Raises:
        ValueError: When ``bits`` or ``coding`` is outside its range.

    Example:
        >>> coding = GeneCoding()
        >>> coding.encode([[0.150, 0.300, 0.950, 0.5, 0.5, 0.5]]).sum()
        np.uint64(72)
    """

    search_range: SearchRange = field(default_factory=SearchRange)
    bits: Annotated[int, Ge(1), Le(31)] = 12
    coding: Literal["binary", "gray"] = "binary"

    def encode(self, poses: ArrayLike) -> Bits:
        """Bits of pose vectors.

        Args:
            poses: Pose vectors, shape (N, 6).

        Returns:
            Zeros and ones, most significant bit first, shape (N, 6 * bits).
        """
        from mffdrake.recognition.genetic import breeding  # numba: slow to import

        genes = breeding.encode(np.array(poses, dtype=float).reshape(-1, 6), self.struct)
        bits = (genes[..., None] >> np.arange(self.bits - 1, -1, -1)) & 1
        return np.asarray(bits, dtype=np.uint8).reshape(len(genes), 6 * self.bits)

    def decode(self, bits: Bits) -> Array:
        """Pose vectors of bits: the inverse of `encode` up to the genes' resolution.

        Args:
            bits: Zeros and ones, shape (N, 6 * bits).

        Returns:
            Pose vectors, shape (N, 6).
        """
        from mffdrake.recognition.genetic import breeding  # numba: slow to import

        digits = np.asarray(bits, dtype=np.int64).reshape(len(bits), 6, self.bits)
        genes = digits @ (1 << np.arange(self.bits - 1, -1, -1))
        poses: Array = breeding.decode(genes, self.struct)
        return poses

    @cached_property
    def struct(self) -> Coding:
        """What the compiled functions take."""
        from mffdrake.recognition.genetic.breeding import Coding  # numba: slow to import

        span = self.search_range
        return Coding(span.lower, span.upper, self.bits, 2**self.bits - 1, self.coding == "gray")


@parameters
class GeneticParameters:
    """How a generation is bred.

    The best share of the population survives unchanged. The others are replaced by children: some
    are small motions of the best individual (`LocalMoves`), some are drawn anew over the whole
    search range, and the rest are two-point crossovers of two survivors whose bits then mutate.
    With ``survivor_share`` one half, ``local_share`` and ``newcomer_share`` zero,
    ``first_candidates`` one and without ``average_best`` this is the plain 1-step GA. The defaults
    were chosen by how often a random start finds the target within 5 s.

    Attributes:
        population_size: Number of hypotheses.
        survivor_share: Share of the population that survives.
        mutation_probability: Chance of each bit of a crossover child to flip.
        local_share: Share of the children that are small motions of the best individual.
        newcomer_share: Share of the children drawn over the whole search range.
        first_candidates: The first population is the best of this many times its size. (Where the
            target is searched for beside the GA, it is drawn once: see `RobustTracker`.)
        average_best: Whether the mean of all that share the highest fitness takes a place in the
            next generation, and local moves start from there instead of from the first of them.

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> plain = GeneticParameters(  # the plain 1-step GA
        ...     survivor_share=0.5, local_share=0, newcomer_share=0,
        ...     first_candidates=1, average_best=False,
        ... )
        >>> plain.population_size
        60
    """

    population_size: Annotated[int, Ge(3), Le(100_000)] = 60
    survivor_share: Share = 0.25
    mutation_probability: Share = 0.02
    local_share: Share = 0.6
    newcomer_share: Share = 0.15
    first_candidates: Annotated[int, Ge(1), Le(100_000)] = 30
    average_best: bool = True

    def __post_init__(self) -> None:
        """Checks the shares together."""
        if self.local_share + self.newcomer_share > 1.0:
            raise ValueError("local_share and newcomer_share together must not exceed 1")


class GeneticAlgorithm:
    """Breeds one generation from a scored one: a step towards the maximum, Eq. (24), (26).

    Args:
        coding: The genes.
        parameters: How to breed.
        local_moves: Draws the children around the best individual.

    Example:
        >>> from mffdrake.recognition.genetic.local_moves import LocalMoveParameters
        >>> moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), LocalMoveParameters())
        >>> algorithm = GeneticAlgorithm(GeneCoding(), GeneticParameters(), moves)
        >>> rng = np.random.default_rng(0)
        >>> first = algorithm.draw(60, rng)
        >>> algorithm.breed(first, np.linspace(1.0, 0.0, 60), rng).shape
        (60, 6)
    """

    def __init__(
        self, coding: GeneCoding, parameters: GeneticParameters, local_moves: LocalMoves
    ) -> None:
        self.coding = coding
        self.parameters = parameters
        self.local_moves = local_moves

    @cached_property
    def _shares(self) -> Shares:
        """What a generation is made of, as the compiled function takes it."""
        from mffdrake.recognition.genetic.breeding import Shares  # numba: slow to import

        p, n = self.parameters, self.parameters.population_size
        num_survivors = min(n - 2, max(1, round(p.survivor_share * n)))
        children = n - num_survivors - p.average_best
        num_local = round(p.local_share * children)
        num_newcomers = min(round(p.newcomer_share * children), children - num_local)
        num_crossed = children - num_local - num_newcomers
        return Shares(
            p.average_best, num_survivors, num_local, num_newcomers, num_crossed,
            float(p.mutation_probability),
        )  # fmt: skip

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Poses drawn evenly over the search range.

        Args:
            count: How many.
            rng: Source of randomness.

        Returns:
            Pose vectors that the genes can represent, shape (count, 6).
        """
        from mffdrake.recognition.genetic import breeding, random_numbers  # numba: slow to import

        genes = breeding.draw_genes(count, 2**self.coding.bits - 1, random_numbers.address_of(rng))
        poses: Array = breeding.decode(genes, self.coding.struct)
        return poses

    def draw_near(
        self, pose: ArrayLike, spread: ArrayLike, count: int, rng: np.random.Generator
    ) -> Array:
        """Poses near a known one, with independent normal deviations of the coordinates.

        Args:
            pose: The center, shape (6,).
            spread: Standard deviations of the position [m] and of the quaternion, shape (2,).
            count: How many.
            rng: Source of randomness.

        Returns:
            Pose vectors that the genes can represent, shape (count, 6).
        """
        deviation = np.repeat(np.asarray(spread, dtype=float), 3)
        poses = np.asarray(pose, dtype=float) + deviation * rng.standard_normal((count, 6))
        return self.coding.decode(self.coding.encode(poses))

    def breed(
        self,
        poses: ArrayLike,
        fitness: ArrayLike,
        rng: np.random.Generator,
        center: ArrayLike | None = None,
    ) -> Array:
        """The next generation, Eq. (27): the center of the best, children, and survivors.

        The fitness counts pixels, so that many poses around the true one have the same. With
        ``average_best`` the first individual is the mean of all that share the highest fitness.
        Children stand before survivors: among equals the former come first when the scored
        generation is sorted, which keeps the equals spread out and the first one in their middle.
        Where a better center is known, a refined pose, that one is the first individual, just as
        it is.

        Args:
            poses: The population, shape (N, 6), already carried to the present (Eq. (23)).
            fitness: Its fitness, shape (N,).
            rng: Source of randomness.
            center: Pose vector that children are drawn around, shape (6,); by default the mean of
                the best.

        Returns:
            Pose vectors that the genes can represent, but for a given center, shape (N, 6).
        """
        from mffdrake.recognition.genetic import breeding, random_numbers  # numba: slow to import

        given = np.empty((0, 6)) if center is None else np.array(center, dtype=float).reshape(1, 6)
        parents = breeding.Parents(
            np.ascontiguousarray(poses, dtype=float),
            np.ascontiguousarray(fitness, dtype=float),
            given,
        )
        next_poses: Array = breeding.breed(
            parents, self._shares, self.coding.struct, self.local_moves.struct,
            random_numbers.address_of(rng),
        )  # fmt: skip
        return next_poses
