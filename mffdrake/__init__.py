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
    "experiment.runs.executors.cluster": "ClusterError DaskCluster",
    "experiment.runs.comparison": "Compare MakeVariants",
    "experiment.simulation.wiring.diagram": "HandEyeParts MakeHandEyeDiagram",
    "experiment.simulation.evaluation": "Evaluate MarkdownTable",
    "experiment.runs.executors.executors": "InProcess WorkerDiedError",
    "experiment.runs.grid": "Grid LoadGrid MakeGrid",
    "experiment.runs.executors.local_processes": "LocalProcesses",
    "experiment.paper.oscillation": "FitOscillation Oscillation",
    "recognition.visibility.outline": "DrawOutline DrawViews",
    "experiment.paper.paper_numbers": "InvarianceRatio PAPER Quartiles Verdict",
    "experiment.simulation.pictures": "DrawCameraView DrawScene SaveDiagram SaveImage",
    "experiment.simulation.plotting": "PlotComparison PlotErrors PlotHandPath PlotPose SaveFigure",
    "recognition.recordings.color_file": "DumpColors LoadColors",
    "experiment.simulation.record": "Record",
    "recognition.recordings.rig_file": "DumpRig LoadRig RigError",
    "experiment.paper.report": "Reproduce WriteReport",
    "experiment.paper.reproduction": "Reproduction RunPlan Summarize",
    "experiment.scenario.scenario": "Change LoadScenario Scenario ScenarioError",
    "experiment.simulation.servo_evaluation": "CalcHandErrors EvaluateServo",
    "experiment.simulation.simulation": "Simulate SimulationResult",
    "experiment.paper.studies": "MakeStudies PLAIN_GA",
    "experiment.runs.study": "PlanRuns Study Variant",
    "experiment.runs.sweep": "Sweep",
    "systems.rendering.visualization": "AddMeshcat PoseEstimateVisualizer SaveReplay",
    "recognition": (
        "AcquisitionParameters AdaptiveWhiteBalance BorderRefiner Camera CameraRig ColorModel "
        "ColoredStart Distortion Estimate FaceColor GeneCoding Generation GeneticParameters "
        "LocalMoveParameters Matcher MatchingParameters NearStart OneStepGaTracker PoseSearch "
        "PoseTracker RandomStart RefinementParameters RobustTracker SamplingParameters "
        "SearchModel SearchParameters SearchRange SolidModel Tracker TrackerParameters "
        "TrackingState"
    ),
    "recognition.camera.calibration": "CalibrationError read_camera",
    "recognition.solid.mesh_file": "ColoredMesh",
    "recognition.poses.pose": "pose_from_transform transform_from_pose",
    "recognition.poses.pose_motion": "transport_pose",
    "systems.arms.arm": "ArmModel",
    "systems.arms.arm_joints": "ArmError",
    "systems.cameras.camera_delay": "AddDelay",
    "systems.cameras.camera_frames": "AddCameraFrame AddCameraFrames",
    "systems.cameras.camera_info": "CameraFromInfo MakeCameraInfo",
    "systems.disturbances": "AddDisturbances",
    "systems.vision.feedforward": "ConnectFeedforward",
    "systems.vision.frame_recorder": "FrameRecorder",
    "systems.rendering.graphics": "GraphicsUnavailableError RequireGraphics",
    "systems.arms.hand_path": "AddHandPathSource HandPath SolveHandPath",
    "systems.arms.inverse_kinematics": "UnreachablePathError",
    "systems.control.joint_encoders": "JointEncoders",
    "systems.arms.models": "ConfigureParser FindModelsPath",
    "systems.arms.pa10": "AddPa10 MakePa10Plant",
    "systems.control.pd_controller": "AddComputedTorque AddGravityCompensation PdController",
    "systems.control.pd_gains": "PD_GAINS NaturalFrequency PdGains",
    "systems.vision.predictor": "MffPredictor",
    "systems.target_motion.prescribed_target": "PrescribedTarget",
    "systems.vision.recognizer": "OneStepGaRecognizer PoseRecognizer",
    "systems.rendering.renderers": "AddRenderer",
    "systems.cameras.stereo_camera": "AddStereoCamera",
    "systems.target_motion": "AtRest Sinusoids Step Straight Waypoint Waypoints",
    "systems.vision.target_motion_estimator": "EstimatorParameters TargetMotionEstimator",
    "systems.timing": "Timing",
    "systems.control.visual_servo": "ServoParameters VisualServoController",
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
