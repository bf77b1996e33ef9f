"""Pose recognition in pure NumPy and compiled kernels: usable on the images of any rig.

Nothing here imports pydrake.
"""

from mffdrake.recognition.acquisition.acquisition import (
    Acquisition,
    AcquisitionParameters,
    NoAcquisition,
)
from mffdrake.recognition.camera.cameras import Camera, CameraRig
from mffdrake.recognition.camera.distortion import Distortion
from mffdrake.recognition.fitness.colors import ColorModel, FaceColor
from mffdrake.recognition.fitness.matching import Matcher, MatchingParameters
from mffdrake.recognition.fitness.white_balance import (
    AdaptiveWhiteBalance,
    FixedWhiteBalance,
    WhiteBalance,
)
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.genetic.genetic import (
    POSE_COORDINATES,
    GeneCoding,
    GeneticAlgorithm,
    GeneticParameters,
    SearchRange,
)
from mffdrake.recognition.genetic.local_moves import LocalMoveParameters, LocalMoves
from mffdrake.recognition.genetic.starts import ColoredStart, NearStart, RandomStart, Start
from mffdrake.recognition.genetic.tracker import OneStepGaTracker
from mffdrake.recognition.parameters import ParameterError
from mffdrake.recognition.poses.pose_filter import PoseFilter, PoseFilterParameters
from mffdrake.recognition.poses.tracking_state import TrackingState
from mffdrake.recognition.refinement.refinement import (
    BorderRefiner,
    NoRefinement,
    Refinement,
    RefinementParameters,
    Refiner,
)
from mffdrake.recognition.solid.solid_model import BLUE, GREEN, RED, SolidModel
from mffdrake.recognition.tracking.any_tracker import Tracker
from mffdrake.recognition.tracking.pose_tracker import Estimate, PoseTracker
from mffdrake.recognition.tracking.robust_tracker import RobustTracker
from mffdrake.recognition.tracking.search import Found, PoseSearch, SearchParameters
from mffdrake.recognition.tracking.tracker_parameters import TrackerParameters
from mffdrake.recognition.visibility.search_model import SamplingParameters, SearchModel

__all__ = [
    "BLUE",
    "GREEN",
    "POSE_COORDINATES",
    "RED",
    "Acquisition",
    "AcquisitionParameters",
    "AdaptiveWhiteBalance",
    "BorderRefiner",
    "Camera",
    "CameraRig",
    "ColorModel",
    "ColoredStart",
    "Distortion",
    "Estimate",
    "FaceColor",
    "FixedWhiteBalance",
    "Found",
    "GeneCoding",
    "Generation",
    "GeneticAlgorithm",
    "GeneticParameters",
    "LocalMoveParameters",
    "LocalMoves",
    "Matcher",
    "MatchingParameters",
    "NearStart",
    "NoAcquisition",
    "NoRefinement",
    "OneStepGaTracker",
    "ParameterError",
    "PoseFilter",
    "PoseFilterParameters",
    "PoseSearch",
    "PoseTracker",
    "RandomStart",
    "Refinement",
    "RefinementParameters",
    "Refiner",
    "RobustTracker",
    "SamplingParameters",
    "SearchModel",
    "SearchParameters",
    "SearchRange",
    "SolidModel",
    "Start",
    "Tracker",
    "TrackerParameters",
    "TrackingState",
    "WhiteBalance",
]
