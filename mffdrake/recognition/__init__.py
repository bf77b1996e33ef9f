"""Pose recognition in pure NumPy and compiled kernels: usable on the images of any rig.

Nothing here imports pydrake.
"""

from mffdrake.recognition.cameras import Camera, CameraRig, Distortion
from mffdrake.recognition.colors import ColorModel, FaceColor
from mffdrake.recognition.genetic import (
    POSE_COORDINATES,
    GeneCoding,
    GeneticAlgorithm,
    GeneticParameters,
    SearchRange,
)
from mffdrake.recognition.local_moves import LocalMoveParameters, LocalMoves
from mffdrake.recognition.matching import Matcher, MatchingParameters
from mffdrake.recognition.refinement import (
    BorderRefiner,
    NoRefinement,
    Refinement,
    RefinementParameters,
    Refiner,
)
from mffdrake.recognition.solid_model import (
    BLUE,
    GREEN,
    RED,
    SamplingParameters,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.tracker import Generation, NearStart, OneStepGaTracker, RandomStart, Start

__all__ = [
    "BLUE",
    "GREEN",
    "POSE_COORDINATES",
    "RED",
    "BorderRefiner",
    "Camera",
    "CameraRig",
    "ColorModel",
    "Distortion",
    "FaceColor",
    "GeneCoding",
    "Generation",
    "GeneticAlgorithm",
    "GeneticParameters",
    "LocalMoveParameters",
    "LocalMoves",
    "Matcher",
    "MatchingParameters",
    "NearStart",
    "NoRefinement",
    "OneStepGaTracker",
    "RandomStart",
    "Refinement",
    "RefinementParameters",
    "Refiner",
    "SamplingParameters",
    "SearchModel",
    "SearchRange",
    "SolidModel",
    "Start",
]
