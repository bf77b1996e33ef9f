"""Sub-pixel refinement of a pose from the color borders along the solid's edges.

The fitness of a pose counts pixels, so that many poses around the true one share the best. What a
picture says beyond that stands in the borders: `BorderRefiner` finds where they lie, to parts of a
pixel, and moves the pose until the projected edges lie there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Protocol

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.fitness.matching import NO_GAINS, Gains, Images, Matcher
from mffdrake.recognition.parameters import Finite, Limit, NonNegative, Share, parameters
from mffdrake.recognition.refinement.outcome import Outcome

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene
    from mffdrake.recognition.refinement.borders import BorderRules, Stage
    from mffdrake.recognition.refinement.refining import Change, Result

Array = NDArray[np.float64]

_IMAGING_ERROR = 0.1  # [px] Borders no farther off are where renderers and lenses put them.


@parameters
class RefinementParameters:
    """Which borders count, how they are weighted, and when a refined pose is accepted.

    Attributes:
        window: How far from the projected edges borders are sought at first [px].
        fine_window: How far once the pose is nearly right [px].
        coarse_spacing: Until then only every n-th row or column is looked at.
        blend: On both sides of a border, pixels that may be a blend of the two colors; beyond
            them lie two pixels that show the colors themselves.
        end_margin: Borders nearer than this to the end of an edge are left out [px]: at a corner a
            third color is near.
        min_cosine: Least cosine between a face's normal and the line from its center to the camera
            for the face to have borders. A face seen more obliquely is a sliver, on both of whose
            sides colors blend.
        min_contrast: Least distance between the colors on the two sides, in grey levels (0-255).
        max_mismatch: How far colors may be off the blend of the two sides, as a share of their
            distance.
        min_borders: Least number of borders, on both images together.
        border_error: Least standard error of one border [px], beside the rounding to pixels.
        edge_error: Standard deviation of the error that all borders of an edge in an image share
            [px]: where a renderer or a lens puts an edge. (On the flat renderer and on VTK it was
            measured to be no more than what rounding explains.)
        min_trusted: Least ratio of inliers: the borders' mean robust weight (0 to 1).
        max_residual: Greatest root-mean-square distance of the inliers from the edges, as a
            multiple of what is expected of the images (`Refinement.expected_residual`). It is
            greater where cameras do not stand or bend as the rig says, and at wrong poses.
        min_fitness: Least fitness of a refined pose (0 to 1).
        max_position_std: Greatest standard deviation of the refined position [m].
        max_rotation_std_deg: Greatest standard deviation of the refined orientation [deg].
        max_shift: Greatest distance of the refined position from the given one [m].
        max_turn_deg: Greatest angle between the refined orientation and the given one [deg].
        fitness_tolerance: How much less fit the refined pose may be than the given one. The
            true pose is not always the fittest: anti-aliasing costs it up to 0.03.

    Raises:
        ValueError: When a parameter is outside its range.

    Example:
        >>> RefinementParameters(window=5).fine_window
        3
    """

    kind: ClassVar[str] = "borders"

    window: Annotated[int, Ge(1), Le(1000)] = 8
    fine_window: Annotated[int, Ge(1), Le(1000)] = 3
    coarse_spacing: Annotated[int, Ge(1), Le(1000)] = 4
    blend: Annotated[int, Ge(1), Le(1000)] = 2
    end_margin: NonNegative = 4.0
    min_cosine: Share = 0.05
    min_contrast: Annotated[Finite, Ge(1), Le(1e9)] = 30.0
    max_mismatch: Share = 0.15
    min_borders: Annotated[int, Ge(6), Le(10**6)] = 40
    border_error: Annotated[Finite, Ge(1e-6), Le(1e9)] = 0.03
    edge_error: NonNegative = 0.01
    min_trusted: Share = 0.5
    max_residual: Limit = 4.0
    min_fitness: Share = 0.15
    max_position_std: Limit = 0.002
    max_rotation_std_deg: Limit = 1.0
    max_shift: Limit = 0.030
    max_turn_deg: Annotated[Finite, Ge(0), Le(180)] = 10.0
    fitness_tolerance: Share = 0.05

    def __post_init__(self) -> None:
        """Checks the windows together."""
        if self.fine_window > self.window:
            raise ValueError(
                f"fine_window must be at most window ({self.window}), not {self.fine_window}"
            )

    def make_refiner(self, matcher: Matcher) -> BorderRefiner:
        """The refiner with these parameters."""
        return BorderRefiner(matcher, self)


@dataclass(frozen=True)
class Refinement:
    """What became of a pose.

    Attributes:
        pose: The refined pose vector, shape (6,); the given one where refinement failed.
        outcome: Whether it is refined, or why not.
        covariance: Covariance of the error of ``pose``, shape (6, 6); NaN where it is not refined.
        fitness: Fitness of ``pose``; NaN where there was no need to know it.
        num_borders: Number of borders that were found.
        explained: Share of the places where a border was sought that show one.
        num_jumps: Number of places where a border jumps to the next pixel.
        inlier_ratio: Mean robust weight of the borders, 0 to 1.
        residual: Root of the mean squared distance of the inliers from the edges [px].
        expected_residual: What rounding, blending and the cameras' calibration explain of it [px].
        aliasing: From 0 for an anti-aliased image, whose borders blend as the covered areas do, to
            1 where every pixel shows one color.
        disagreement: How far one camera's borders alone would move the pose [m], beyond what
            chance explains.

    Example:
        >>> given = np.array([0.0, 0.155, 0.8, 0.0, 0.0, 0.0])
        >>> Refinement(given, Outcome.TOO_FEW_BORDERS).reason
        'too few borders'
    """

    pose: Array
    outcome: Outcome = Outcome.OFF
    covariance: Array = field(default_factory=lambda: np.full((6, 6), math.nan))
    fitness: float = math.nan
    num_borders: int = 0
    explained: float = 0.0
    num_jumps: int = 0
    inlier_ratio: float = 0.0
    residual: float = math.nan
    expected_residual: float = math.nan
    aliasing: float = math.nan
    disagreement: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether ``pose`` is refined."""
        return self.outcome == Outcome.CONVERGED

    @property
    def reason(self) -> str:
        """Why ``pose`` is not refined, in words; empty where it is."""
        return self.outcome.message


class Refiner(Protocol):
    """Makes a pose more accurate.

    Example:
        >>> refiner: Refiner = NoRefinement()  # or a `BorderRefiner`, or one's own
    """

    def refine_scene(self, pose: ArrayLike, scene: Scene) -> Refinement:
        """The refined pose, or the given one with a reason, on images made ready."""
        ...


@parameters
class NoRefinement:
    """Leaves poses as they are.

    Example:
        >>> NoRefinement().kind
        'none'
    """

    kind: ClassVar[str] = "none"

    def refine_scene(self, pose: ArrayLike, scene: Scene) -> Refinement:
        """The given pose, not refined."""
        return Refinement(np.array(pose, dtype=float))

    def make_refiner(self, matcher: Matcher) -> NoRefinement:
        """Itself, which needs to know nothing of the matcher."""
        return self


class BorderRefiner:
    """Refines a pose by a few robust Gauss-Newton steps on the color borders in both images.

    *Borders.* A visible edge has one where the two sides differ in color: a silhouette edge, where
    one of its faces is visible, or an inner edge, where both are and differ in hue. Each is sought
    on the image's rows (on columns, for an edge nearer to the horizontal). Where a row crosses from
    the face's hue to another color, the covered shares of the few pixels in between add up to the
    border's place at the row's middle. That sum has no bias, whether pixels blend the colors by the
    covered area or show one color only: then it is the true place rounded to whole pixels, evenly
    from -1/2 to 1/2 px off. Borders with the wrong hue on the inside, with a third color, or with
    little contrast do not count; wrong ones that remain are taken out by Tukey's weights.

    *Aliasing.* The mean of the covered shares tells how aliased an image is: pixels of one color
    only (1), or blended by area (0). In an aliased image, neighbors along an edge that is nearly a
    row or column share their error, so that they count as one. But where their pixel changes, the
    edge passes through that pixel's center, which a slope m locates to m/sqrt(12) px: those jumps
    carry most of what such an image tells. From an aliasing of 0.7 on, the steps end in the middle
    of all poses that round to the same borders (`centering`), where there are such poses: a row
    tells only between which two pixel centers the edge passes, and where edges run along the
    pixels' rows and few rows differ, least squares need not end there.

    *Steps.* The border on a row moves by ``f n.dX / (depth n_u)`` as the target's point there moves
    by ``dX = dt + dtheta x (X - t)``, with n the normal of the plane through the edge and the
    camera's center. All borders of both images give one least-squares system for ``(dt, dtheta)``,
    weighted with the inverse of a covariance in which the borders of an edge share an error.

    *Covariance.* It is the inverse of that system's matrix, carried over to the pose vector by
    ``deps = 1/2 (eta I - S(eps)) dtheta``, Eq. (6). In an aliased image's middle it is twice the
    barrier's inverse curvature, by experiment. What calibrations may leave comes on top.

    Args:
        matcher: The solid, the camera and the tolerances of hue; it also checks the result.
        parameters: What counts.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> refiner = BorderRefiner(Matcher(SearchModel(box), CameraRig.stereo()))
        >>> grey = np.full((480, 640, 3), 128, dtype=np.uint8)
        >>> refiner.refine([0.0, 0.155, 0.8, 0.0, 0.0, 0.0], [grey, grey]).reason
        'too few borders'
    """

    def __init__(self, matcher: Matcher, parameters: RefinementParameters | None = None) -> None:
        self.matcher = matcher
        self.parameters = RefinementParameters() if parameters is None else parameters

    @cached_property
    def rules(self) -> BorderRules:
        """Which borders count, as the compiled functions take it."""
        from mffdrake.recognition.refinement.borders import BorderRules  # numba: slow to import

        p = self.parameters
        return BorderRules(
            p.blend, float(p.end_margin), float(p.min_cosine), float(p.min_contrast),
            float(p.max_mismatch), p.min_borders, float(p.border_error), float(p.edge_error),
        )  # fmt: skip

    @cached_property
    def _calibration_error(self) -> float:
        """Root mean square of the cameras' [px]."""
        errors = [camera.calibration_error for camera in self.matcher.rig.cameras]
        return math.sqrt(float(np.mean(np.square(errors))))

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Three stages: from afar, near, and on every row with as many steps as it takes."""
        from mffdrake.recognition.refinement.borders import Stage  # numba: slow to import

        p = self.parameters
        return (
            Stage(p.window, p.coarse_spacing, 2),
            Stage(p.fine_window, p.coarse_spacing, 2),
            Stage(p.fine_window, 1, 8),
        )

    def refine(self, pose: ArrayLike, images: Images, *, gains: Gains = NO_GAINS) -> Refinement:
        """Refines a pose that is right to within a few millimeters and degrees.

        Args:
            pose: Pose vector ``(r [m], eps)``, shape (6,).
            images: One a camera, uint8, shape (height, width, 3 or 4).
            gains: White balance.

        Returns:
            The refined pose; or the given one, with the reason, when the images say too little or
            nothing consistent, or the refined pose would be less fit.

        Raises:
            ValueError: When an image is missing, or has another type or size than its camera's.
        """
        return self.refine_scene(pose, self.matcher.scene(images, gains))

    def refine_scene(self, pose: ArrayLike, scene: Scene) -> Refinement:
        """`refine` on images that were made ready before.

        Args:
            pose: Pose vector ``(r [m], eps)``, shape (6,).
            scene: What `Matcher.scene` made of the images.
        """
        from mffdrake.recognition.refinement import refining  # numba: slow to import

        given = np.array(pose, dtype=float).reshape(6)
        samples, matching = self.matcher.structs[1:]
        (code, *rest), changed = refining.refine(
            given, scene, samples, matching, self.rules, self.stages
        )
        result, change = refining.Result(Outcome(code), *rest), refining.Change(*changed)
        expected = math.hypot(
            max(self.parameters.border_error, _IMAGING_ERROR),
            math.sqrt(result.aliasing / 12.0),
            self._calibration_error,
        )
        outcome = self._judge(result, change, expected)
        found: dict[str, Any] = {
            "num_borders": result.num_borders,
            "explained": result.num_borders / max(1, result.sought),
            "num_jumps": result.num_jumps, "inlier_ratio": result.inlier_ratio,
            "residual": result.residual, "expected_residual": expected,
            "aliasing": result.aliasing,
            "disagreement": result.disagreement,
        }  # fmt: skip
        if outcome != Outcome.CONVERGED:
            return Refinement(given, outcome, **found)
        return Refinement(result.pose, outcome, change.covariance, change.fitness, **found)

    def _judge(self, result: Result, change: Change, expected: float) -> Outcome:
        """Whether a pose at which the steps ended is accepted."""
        p, variances = self.parameters, np.diag(result.covariance).tolist()
        far, wide = p.max_position_std, math.radians(p.max_rotation_std_deg)
        # Products overflow to infinity, powers to an error.
        certain = sum(variances[:3]) <= far * far and sum(variances[3:]) <= wide * wide
        near = change.shift <= p.max_shift and change.turn <= math.radians(p.max_turn_deg)
        for fails, outcome in (
            (result.outcome != Outcome.CONVERGED, result.outcome),
            (result.inlier_ratio < p.min_trusted, Outcome.TOO_FEW_INLIERS),
            (result.residual > p.max_residual * expected, Outcome.LARGE_RESIDUAL),
            (not certain, Outcome.UNCERTAIN),
            (not near, Outcome.TOO_FAR),
            (change.fitness < change.before - p.fitness_tolerance, Outcome.LESS_FIT),
            (change.fitness < p.min_fitness, Outcome.UNFIT),
        ):
            if fails:
                return outcome
        return Outcome.CONVERGED
