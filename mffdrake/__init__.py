"""Pose recognition by a moving stereo camera, with motion feedforward, as Drake systems.

These are the public names of the three rooms: `mffdrake.recognition` (no simulator),
`mffdrake.systems` (Drake systems) and `mffdrake.experiment` (scenarios, simulations, results).
They load when they are first used, so importing the package takes no time. `__init__.pyi` tells
editors and type checkers where they are.
"""

from __future__ import annotations

import importlib
from typing import Any

_MODULES = {
    "experiment.cluster": "ClusterError DaskCluster",
    "experiment.comparison": "Compare MakeVariants",
    "experiment.diagram": "HandEyeParts MakeHandEyeDiagram",
    "experiment.evaluation": "Evaluate MarkdownTable",
    "experiment.executors": "InProcess WorkerDiedError",
    "experiment.grid": "Grid LoadGrid MakeGrid",
    "experiment.local_processes": "LocalProcesses",
    "experiment.oscillation": "FitOscillation Oscillation",
    "experiment.outline": "DrawOutline DrawViews",
    "experiment.paper_numbers": "InvarianceRatio PAPER Quartiles Verdict",
    "experiment.pictures": "DrawCameraView DrawScene SaveDiagram SaveImage",
    "experiment.plotting": "PlotComparison PlotErrors PlotHandPath PlotPose SaveFigure",
    "experiment.recordings.color_file": "DumpColors LoadColors",
    "experiment.recordings.record": "Record",
    "experiment.recordings.rig_file": "DumpRig LoadRig RigError",
    "experiment.report": "Reproduce WriteReport",
    "experiment.reproduction": "Reproduction RunPlan Summarize",
    "experiment.scenario": "Change LoadScenario Scenario ScenarioError",
    "experiment.servo_evaluation": "CalcHandErrors EvaluateServo",
    "experiment.simulation": "Simulate SimulationResult",
    "experiment.studies": "MakeStudies PLAIN_GA",
    "experiment.study": "PlanRuns Study Variant",
    "experiment.sweep": "Sweep",
    "experiment.visualization": "AddMeshcat PoseEstimateVisualizer SaveReplay",
    "recognition": (
        "AcquisitionParameters AdaptiveWhiteBalance BorderRefiner Camera CameraRig ColorModel "
        "ColoredStart Distortion Estimate FaceColor GeneCoding Generation GeneticParameters "
        "LocalMoveParameters Matcher MatchingParameters NearStart OneStepGaTracker PoseSearch "
        "PoseTracker RandomStart RefinementParameters RobustTracker SamplingParameters "
        "SearchModel SearchParameters SearchRange SolidModel Tracker TrackerParameters "
        "TrackingState"
    ),
    "recognition.calibration": "CalibrationError read_camera",
    "recognition.mesh_file": "ColoredMesh",
    "recognition.pose": "pose_from_transform transform_from_pose",
    "recognition.pose_motion": "transport_pose",
    "systems.arm": "ArmModel",
    "systems.arm_joints": "ArmError",
    "systems.camera_delay": "AddDelay",
    "systems.camera_frames": "AddCameraFrame AddCameraFrames",
    "systems.camera_info": "CameraFromInfo MakeCameraInfo",
    "systems.disturbances": "AddDisturbances",
    "systems.feedforward": "ConnectFeedforward",
    "systems.frame_recorder": "FrameRecorder",
    "systems.graphics": "GraphicsUnavailableError RequireGraphics",
    "systems.hand_path": "AddHandPathSource HandPath SolveHandPath",
    "systems.inverse_kinematics": "UnreachablePathError",
    "systems.joint_encoders": "JointEncoders",
    "systems.models": "ConfigureParser FindModelsPath",
    "systems.pa10": "AddPa10 MakePa10Plant",
    "systems.pd_controller": "AddComputedTorque AddGravityCompensation PdController",
    "systems.pd_gains": "PD_GAINS NaturalFrequency PdGains",
    "systems.predictor": "MffPredictor",
    "systems.prescribed_target": "PrescribedTarget",
    "systems.recognizer": "OneStepGaRecognizer PoseRecognizer",
    "systems.renderers": "AddRenderer",
    "systems.stereo_camera": "AddStereoCamera",
    "systems.target_motion": "AtRest Sinusoids Step Straight Waypoint Waypoints",
    "systems.target_motion_estimator": "EstimatorParameters TargetMotionEstimator",
    "systems.timing": "Timing",
    "systems.visual_servo": "ServoParameters VisualServoController",
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    """Loads a public name's module when the name is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'mffdrake' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"mffdrake.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *__all__]
