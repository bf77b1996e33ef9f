"""The sections of a scenario, each the parameters of one part of the system."""

# No `from __future__ import annotations`: Drake's YAML reader needs the fields' types themselves.

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Literal, TypeVar, cast

from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw

from mffdrake.recognition import (
    GeneCoding,
    GeneticParameters,
    LocalMoveParameters,
    MatchingParameters,
    NearStart,
    SamplingParameters,
    SearchRange,
)
from mffdrake.systems.hand_path import HandPath
from mffdrake.systems.pa10 import DEFAULT_BASELINE, DEFAULT_P_EC
from mffdrake.systems.timing import Timing

__all__ = [
    "CameraConfig",
    "ControllerConfig",
    "EncodersConfig",
    "HandPathConfig",
    "LocalMovesConfig",
    "MatchingConfig",
    "PredictorConfig",
    "RecognizerConfig",
    "SamplingConfig",
    "SearchRangeConfig",
    "TargetConfig",
    "TimingConfig",
]


def _LikeFirstHandPose(translation: list[float]) -> Transform:
    """A pose with the axes of the paper's first hand pose: z forward, x right, y down."""
    return Transform(RigidTransform(RollPitchYaw(-0.5 * math.pi, 0, -0.5 * math.pi), translation))


def _List(values: Sequence[float]) -> list[float]:
    """A list field with a default of its own; Drake's YAML reader knows no tuples."""
    return dc.field(default_factory=lambda: list(values))


@dc.dataclass(kw_only=True, slots=True)
class HandPathConfig:
    """The hand's desired path, Eq. (29)-(31).

    Attributes:
        amplitude_deg: Largest angle of the swing [deg].
        distance: Radius of the circle on which the hand moves [m].
        omega: Angular frequency of the swing [rad/s].
        X_WE0: The hand's first pose, Eq. (29).
    """

    amplitude_deg: float = 15.0
    distance: float = 0.8
    omega: float = 0.105
    X_WE0: Transform = dc.field(default_factory=lambda: _LikeFirstHandPose([0.918, 0.0, 0.455]))

    def Make(self) -> HandPath:
        """The path."""
        return HandPath(
            amplitude=math.radians(self.amplitude_deg),
            distance=self.distance,
            omega=self.omega,
            X_WE0=self.X_WE0.GetDeterministicValue(),
        )


@dc.dataclass(kw_only=True, slots=True)
class ControllerConfig:
    """The PD controller.

    Attributes:
        gains: Name of a preset: "lightly_damped" (the paper's Fig. 6) or "well_damped".
        kp: Proportional gains [N m/rad], one a joint; they replace the preset's.
        kd: Derivative gains [N m s/rad], likewise.
        gravity_compensation: Whether the arm's weight is compensated.
    """

    gains: str = "lightly_damped"
    kp: list[float] | None = None
    kd: list[float] | None = None
    gravity_compensation: bool = True


@dc.dataclass(kw_only=True, slots=True)
class CameraConfig:
    """The stereo camera on the hand.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        fov_y_deg: Vertical field of view [deg].
        baseline: Distance between the cameras [m].
        p_EC: The right camera's position in the hand's frame [m].
        latency: Age of the images when they arrive [s], a whole multiple of the control period.
    """

    width: int = 640
    height: int = 480
    fov_y_deg: float = 45.0
    baseline: float = DEFAULT_BASELINE
    p_EC: list[float] = _List(DEFAULT_P_EC)
    latency: float = 0.0


@dc.dataclass(kw_only=True, slots=True)
class EncodersConfig:
    """The joint encoders, which the controller and the motion feedforward read.

    Attributes:
        noise_deg: Standard deviation of a joint angle's error, another one every tick [deg].
    """

    noise_deg: float = 0.0


@dc.dataclass(kw_only=True, slots=True)
class TargetConfig:
    """The known object.

    Attributes:
        model: URL or path of its SDF, whose visual is one convex mesh with a material a face.
        X_WM: Its pose in the world.
    """

    model: str = "package://mffdrake/target_box.sdf"
    X_WM: Transform = dc.field(default_factory=lambda: _LikeFirstHandPose([1.718, 0.0, 0.455]))


@dc.dataclass(kw_only=True, slots=True)
class SearchRangeConfig:
    """Least and greatest of every coordinate [m]; see `SearchRange`."""

    x: list[float] = _List(SearchRange.x)
    y: list[float] = _List(SearchRange.y)
    z: list[float] = _List(SearchRange.z)
    eps1: list[float] = _List(SearchRange.eps1)
    eps2: list[float] = _List(SearchRange.eps2)
    eps3: list[float] = _List(SearchRange.eps3)


@dc.dataclass(kw_only=True, slots=True)
class SamplingConfig:
    """How densely the solid is sampled [m]; see `SamplingParameters`."""

    spacing: float = SamplingParameters.spacing
    min_cells: int = SamplingParameters.min_cells
    margin: float | None = SamplingParameters.margin
    strip_offsets: list[float] = _List(SamplingParameters.strip_offsets)


@dc.dataclass(kw_only=True, slots=True)
class MatchingConfig:
    """When a pixel has a face's color, and what counts; see `MatchingParameters`."""

    hue_tolerance_deg: float = MatchingParameters.hue_tolerance_deg
    min_saturation: float = MatchingParameters.min_saturation
    min_value: float = MatchingParameters.min_value
    min_chroma: float = MatchingParameters.min_chroma
    min_cosine: float = MatchingParameters.min_cosine
    min_border_distance: float = MatchingParameters.min_border_distance


@dc.dataclass(kw_only=True, slots=True)
class LocalMovesConfig:
    """How far the small motions go; see `LocalMoveParameters`."""

    depth: float = LocalMoveParameters.depth
    shift: float = LocalMoveParameters.shift
    rotation_deg: float = LocalMoveParameters.rotation_deg
    decades: float = LocalMoveParameters.decades
    sparsity: float = LocalMoveParameters.sparsity


_Coding = Literal["binary", "gray"]
_Parameters = TypeVar("_Parameters")


def _Made(
    config: SearchRangeConfig | SamplingConfig | MatchingConfig | LocalMovesConfig,
    kind: type[_Parameters],
) -> _Parameters:
    """The parameter object with a section's values; it checks their ranges."""
    values = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in dc.asdict(config).items()
    }
    return kind(**values)


@dc.dataclass(kw_only=True, slots=True)
class RecognizerConfig:
    """The recognizer.

    Attributes:
        population_size: Number of hypotheses.
        generations_per_frame: Generations on one frame's images; the paper's 1.
        coding: "binary" (the paper's) or "gray".
        bits: Bits a gene.
        survivor_share: See `GeneticParameters`, as for the next five.
        mutation_probability: Chance of a bit to flip.
        local_share: Share of the children that are small motions of the best individual.
        newcomer_share: Share of the children drawn over the whole range.
        first_candidates: The first population is the best of so many times its size.
        average_best: Whether the mean of the equally best takes a place.
        search_range: Least and greatest of x, y, z [m], eps1, eps2, eps3.
        refinement: "none" (the paper's), or "borders": every frame's pose is refined to parts of a
            pixel, see `BorderRefiner`.
        white_balance_rate: Greatest relative change a frame by which the color channels' gains
            follow the light while tracking is sure, see `AdaptiveWhiteBalance`; 0 for fixed ones.
        start: First population: "random" over the range, or "near_target" (as the paper's).
        start_spread: Its standard deviations when near the target: position [m] and quaternion.
        sampling: How densely the solid is sampled, see `SamplingParameters`.
        matching: Tolerances, see `MatchingParameters`.
        local_moves: How far the small motions go, see `LocalMoveParameters`.
    """

    population_size: int = GeneticParameters.population_size
    generations_per_frame: int = 1
    coding: str = GeneCoding.coding
    bits: int = GeneCoding.bits
    survivor_share: float = GeneticParameters.survivor_share
    mutation_probability: float = GeneticParameters.mutation_probability
    local_share: float = GeneticParameters.local_share
    newcomer_share: float = GeneticParameters.newcomer_share
    first_candidates: int = GeneticParameters.first_candidates
    average_best: bool = GeneticParameters.average_best
    search_range: SearchRangeConfig = dc.field(default_factory=SearchRangeConfig)
    refinement: str = "none"
    white_balance_rate: float = 0.0
    start: str = "random"
    start_spread: list[float] = _List(NearStart.spread)
    sampling: SamplingConfig = dc.field(default_factory=SamplingConfig)
    matching: MatchingConfig = dc.field(default_factory=MatchingConfig)
    local_moves: LocalMovesConfig = dc.field(default_factory=LocalMovesConfig)

    def MakeCoding(self) -> GeneCoding:
        """The genes."""
        return GeneCoding(
            search_range=_Made(self.search_range, SearchRange),
            bits=self.bits,
            coding=cast(_Coding, self.coding),
        )

    def MakeParameters(self) -> GeneticParameters:
        """How a generation is bred."""
        return GeneticParameters(
            **{f.name: getattr(self, f.name) for f in dc.fields(GeneticParameters)}
        )

    def MakeSampling(self) -> SamplingParameters:
        """How densely the solid is sampled."""
        return _Made(self.sampling, SamplingParameters)

    def MakeMatching(self) -> MatchingParameters:
        """The tolerances of a match."""
        return _Made(self.matching, MatchingParameters)

    def MakeLocalMoves(self) -> LocalMoveParameters:
        """How far the small motions go."""
        return _Made(self.local_moves, LocalMoveParameters)


@dc.dataclass(kw_only=True, slots=True)
class PredictorConfig:
    """The motion feedforward; see `MffPredictor`.

    Attributes:
        mode: "rigid" (exact) or "velocity" (Eq. 12).
        latency: The age of the images that it reckons with [s]; null for the cameras' own.
        gain: Share of the predicted motion that is applied.
        hand_eye_error_deg: Roll, pitch and yaw by which the cameras' orientation on the hand, as it
            is known, differs from the true one [deg].
    """

    mode: str = "rigid"
    latency: float | None = None
    gain: float = 1.0
    hand_eye_error_deg: list[float] = _List([0.0, 0.0, 0.0])


@dc.dataclass(kw_only=True, slots=True)
class TimingConfig:
    """The two rates.

    Attributes:
        control_period: Time between control ticks [s].
        vision_period: Time between frames [s], a whole multiple.
    """

    control_period: float = Timing.control_period
    vision_period: float = Timing.vision_period

    def Make(self) -> Timing:
        """The timing."""
        return Timing(control_period=self.control_period, vision_period=self.vision_period)
