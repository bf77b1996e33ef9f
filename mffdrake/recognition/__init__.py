"""Pose recognition in pure NumPy and compiled kernels: usable on the images of any rig.

Nothing here imports pydrake.
"""

from mffdrake.recognition.acquisition import Acquisition, AcquisitionParameters, NoAcquisition
from mffdrake.recognition.any_tracker import Tracker
from mffdrake.recognition.cameras import Camera, CameraRig
from mffdrake.recognition.colors import ColorModel, FaceColor
from mffdrake.recognition.distortion import Distortion
from mffdrake.recognition.generation import Generation
from mffdrake.recognition.genetic import (
    POSE_COORDINATES,
    GeneCoding,
    GeneticAlgorithm,
    GeneticParameters,
    SearchRange,
)
from mffdrake.recognition.local_moves import LocalMoveParameters, LocalMoves
from mffdrake.recognition.matching import Matcher, MatchingParameters
from mffdrake.recognition.parameters import ParameterError
from mffdrake.recognition.pose_filter import PoseFilter, PoseFilterParameters
from mffdrake.recognition.pose_tracker import Estimate, PoseTracker
from mffdrake.recognition.refinement import (
    BorderRefiner,
    NoRefinement,
    Refinement,
    RefinementParameters,
    Refiner,
)
from mffdrake.recognition.robust_tracker import RobustTracker
from mffdrake.recognition.search import Found, PoseSearch, SearchParameters
from mffdrake.recognition.search_model import SamplingParameters, SearchModel
from mffdrake.recognition.solid_model import BLUE, GREEN, RED, SolidModel
from mffdrake.recognition.starts import ColoredStart, NearStart, RandomStart, Start
from mffdrake.recognition.tracker import OneStepGaTracker
from mffdrake.recognition.tracker_parameters import TrackerParameters
from mffdrake.recognition.tracking_state import TrackingState
from mffdrake.recognition.white_balance import (
    AdaptiveWhiteBalance,
    FixedWhiteBalance,
    WhiteBalance,
)

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
