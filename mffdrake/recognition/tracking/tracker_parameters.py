"""All parameters of a 1-step GA tracker in one place, and the tracker that they make."""

from __future__ import annotations

import dataclasses as dc
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from mffdrake.recognition.acquisition.acquisition import AcquisitionParameters, NoAcquisition
from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.fitness.colors import ColorModel
from mffdrake.recognition.fitness.matching import Matcher, MatchingParameters
from mffdrake.recognition.fitness.white_balance import AdaptiveWhiteBalance, FixedWhiteBalance
from mffdrake.recognition.genetic.genetic import GeneCoding, GeneticParameters, SearchRange
from mffdrake.recognition.genetic.local_moves import LocalMoveParameters
from mffdrake.recognition.genetic.starts import NearStart, RandomStart, Start
from mffdrake.recognition.genetic.tracker import OneStepGaTracker
from mffdrake.recognition.parameters import Finite, OneOf, Share, merge, parameters, read_parameters
from mffdrake.recognition.parameters.yaml_text import ReadYaml
from mffdrake.recognition.refinement.refinement import (
    BorderRefiner,
    NoRefinement,
    RefinementParameters,
)
from mffdrake.recognition.solid.solid_model import SolidModel
from mffdrake.recognition.tracking.robust_tracker import RobustTracker
from mffdrake.recognition.visibility.search_model import SamplingParameters, SearchModel

__all__ = ["TrackerParameters"]


_Spread = Annotated[Finite, Ge(0), Le(1e3)]


@parameters
class TrackerParameters(GeneticParameters, GeneCoding):
    """A tracker's parameters: how it breeds and codes, and what else it does on a frame.

    Attributes:
        generations_per_frame: Generations on one frame's images; the paper's 1.
        refinement: "none" (the paper's), or "borders": every frame's pose is refined to parts of a
            pixel, see `BorderRefiner`; with parameters of its own: ``!Borders {window: 8}``.
        acquisition: Where poses are refined: "blobs": the target is searched for where the images
            show its colors, and poses are judged, see `RobustTracker`; with parameters of its own:
            ``!Blobs {found: 0.5}``. Or "none": the GA alone.
        white_balance_rate: Greatest relative change a frame by which the color channels' gains
            follow the light while tracking is sure, see `AdaptiveWhiteBalance`; 0 for fixed ones.
        start: First population: "random" over the range, or "near_target" (as the paper's).
        start_spread: Its standard deviations when near the target: position [m] and quaternion.
        sampling: How densely the solid is sampled.
        matching: When a pixel has a face's color, and what counts.
        local_moves: How far the small motions go.

    Raises:
        ParameterError: When a parameter is outside its range.

    Example:
        >>> from mffdrake.recognition.parameters import read_parameters
        >>> data = {"bits": 14, "refinement": "borders"}
        >>> read_parameters(TrackerParameters, data).refinement.window
        8
    """

    generations_per_frame: Annotated[int, Ge(1), Le(10_000)] = 1
    refinement: Annotated[NoRefinement | RefinementParameters, OneOf()] = dc.field(
        default_factory=NoRefinement
    )
    acquisition: Annotated[NoAcquisition | AcquisitionParameters, OneOf()] = dc.field(
        default_factory=AcquisitionParameters
    )
    white_balance_rate: Share = 0.0
    start: Literal["random", "near_target"] = "random"
    start_spread: tuple[_Spread, _Spread] = NearStart.spread
    sampling: SamplingParameters = dc.field(default_factory=SamplingParameters)
    matching: MatchingParameters = dc.field(default_factory=MatchingParameters)
    local_moves: LocalMoveParameters = dc.field(default_factory=LocalMoveParameters)

    @classmethod
    def in_view(cls, rig: CameraRig, solid: SolidModel) -> TrackerParameters:
        """For images of which nothing else is known: any pose in view, refined and judged.

        Args:
            rig: The cameras.
            solid: The object to recognize.

        Example:
            >>> from mffdrake.recognition import BLUE, GREEN, RED
            >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
            >>> TrackerParameters.in_view(CameraRig.stereo(), box).search_range.eps1
            (-1.0, 1.0)
        """
        return cls(
            search_range=SearchRange.in_view(rig, solid.size), refinement=RefinementParameters()
        )

    @classmethod
    def read(cls, text: str, default: TrackerParameters | None = None) -> TrackerParameters:
        """Reads a scenario's section ``recognizer`` by itself.

        Args:
            text: YAML with the section's keys.
            default: What has the other keys' values; None for a scenario's.

        Raises:
            ParameterError: When a key is unknown or a value has the wrong type or range.

        Example:
            >>> TrackerParameters.read("{bits: 14, search_range: {z: [-0.1, 0.2]}}").bits
            14
        """
        return read_parameters(cls, merge(default or cls(), ReadYaml(text)), "recognizer")

    def make_tracker(
        self,
        *,
        solid: SolidModel,
        rig: CameraRig,
        seed: int = 0,
        start_pose: NDArray[np.float64] | None = None,
        colors: ColorModel | None = None,
    ) -> OneStepGaTracker | RobustTracker:
        """The tracker.

        Args:
            solid: The object to recognize.
            rig: The cameras.
            seed: Of the random numbers.
            start_pose: Where the first population lies for ``start: near_target``: the target's
                pose vector in the rig's frame, shape (6,).
            colors: How the solid's materials look; by default as its mesh has them.

        Returns:
            The tracker.

        Raises:
            ValueError: When the colors lack one of the solid's materials, or the start is near a
                target whose pose is not given.

        Example:
            >>> from mffdrake.recognition import BLUE, GREEN, RED
            >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
            >>> tracker = TrackerParameters(bits=14).make_tracker(solid=box, rig=CameraRig.stereo())
            >>> tracker.coding.bits
            14
        """
        matcher = Matcher(SearchModel(solid, self.sampling), rig, self.matching, colors)
        rate = self.white_balance_rate
        ga = OneStepGaTracker(
            matcher=matcher,
            coding=self,
            parameters=self,
            local_moves=self.local_moves,
            generations_per_frame=self.generations_per_frame,
            start=self._make_start(start_pose),
            refiner=self.refinement.make_refiner(matcher),
            white_balance=AdaptiveWhiteBalance(rate) if rate > 0.0 else FixedWhiteBalance(),
            seed=seed,
        )
        if isinstance(ga.refiner, BorderRefiner) and isinstance(
            self.acquisition, AcquisitionParameters
        ):
            return RobustTracker(ga=ga, parameters=self.acquisition)
        return ga

    def _make_start(self, pose: NDArray[np.float64] | None) -> Start:
        if self.start == "random":
            return RandomStart()
        if pose is None:
            raise ValueError("start is near_target, but no start_pose is given")
        return NearStart(pose, self.start_spread)
