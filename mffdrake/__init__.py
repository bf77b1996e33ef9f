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
    "experiment.paper.oscillation": "FitOscillation Oscillation",
    "experiment.paper.paper_numbers": "InvarianceRatio PAPER Verdict",
    "experiment.paper.report.report": "Reproduce WriteReport",
    "experiment.paper.studies": "MakeStudies PLAIN_GA",
    "experiment.paper.study": "PlanRuns Reproduction Study Summarize Variant",
    "experiment.runs.compare": "Compare MakeVariants",
    "experiment.runs.engine": "EndedRun PlannedRun RunPlan",
    "experiment.runs.executors.cluster": "ClusterError DaskCluster",
    "experiment.runs.executors.executors": "InProcess WorkerDiedError",
    "experiment.runs.executors.local_processes": "LocalProcesses",
    "experiment.runs.grid": "Grid LoadGrid MakeGrid",
    "experiment.runs.pictures": "PlotComparison PlotErrors",
    "experiment.runs.store": "MemoryStore RunStore",
    "experiment.runs.sweep": "Sweep",
    "experiment.runs.table": "MarkdownTable Quartiles SummaryTable",
    "experiment.scenario.scenario": "Change LoadScenario Scenario ScenarioError",
    "experiment.simulation.evaluation": "Evaluate",
    "experiment.simulation.pictures": "DrawCameraView DrawScene",
    "experiment.simulation.plotting": "PlotHandPath PlotPose SaveFigure",
    "experiment.simulation.record": "Record",
    "experiment.simulation.recovery": "CalcHandErrors",
    "experiment.simulation.simulation": "Simulate SimulationResult",
    "experiment.simulation.wiring.diagram": "HandEyeParts MakeHandEyeDiagram",
    "recognition": "AcquisitionParameters AdaptiveWhiteBalance BorderRefiner Camera CameraRig ColorModel ColoredStart Distortion Estimate FaceColor GeneCoding Generation GeneticParameters LocalMoveParameters Matcher MatchingParameters NearStart OneStepGaTracker PoseSearch PoseTracker RandomStart RefinementParameters RobustTracker SamplingParameters SearchModel SearchParameters SearchRange SolidModel Tracker TrackerParameters TrackingState",
    "recognition.camera.calibration": "CalibrationError read_camera",
    "recognition.poses.pose": "pose_from_transform transform_from_pose",
    "recognition.poses.pose_motion": "transport_pose",
    "recognition.recordings.color_file": "DumpColors LoadColors",
    "recognition.recordings.image_files": "SaveImage",
    "recognition.solid.mesh_file": "ColoredMesh",
    "recognition.visibility.outline": "DrawOutline DrawViews",
    "systems.arms.arm": "ArmModel",
    "systems.arms.arm_joints": "ArmError",
    "systems.arms.hand_path": "AddHandPathSource HandPath SolveHandPath",
    "systems.arms.inverse_kinematics": "UnreachablePathError",
    "systems.arms.models": "ConfigureParser FindModelsPath",
    "systems.arms.pa10": "AddPa10 MakePa10Plant",
    "systems.cameras.camera_delay": "AddDelay",
    "systems.cameras.camera_frames": "AddCameraFrame AddCameraFrames",
    "systems.cameras.camera_info": "CameraFromInfo MakeCameraInfo",
    "systems.cameras.rig_file": "DumpRig LoadRig RigError",
    "systems.cameras.stereo_camera": "AddStereoCamera",
    "systems.control.joint_encoders": "JointEncoders",
    "systems.control.pd_controller": "AddComputedTorque AddGravityCompensation PdController",
    "systems.control.pd_gains": "NaturalFrequency PD_GAINS PdGains",
    "systems.control.visual_servo": "ServoParameters VisualServoController",
    "systems.disturbances": "AddDisturbances",
    "systems.rendering.graphics": "GraphicsUnavailableError RequireGraphics",
    "systems.rendering.renderers": "AddRenderer",
    "systems.rendering.visualization": "AddMeshcat PoseEstimateVisualizer SaveDiagram SaveReplay",
    "systems.target_motion": "AtRest Sinusoids Step Straight Waypoint Waypoints",
    "systems.target_motion.prescribed_target": "PrescribedTarget",
    "systems.timing": "Timing",
    "systems.vision.feedforward": "ConnectFeedforward",
    "systems.vision.frame_recorder": "FrameRecorder",
    "systems.vision.predictor": "MffPredictor",
    "systems.vision.recognizer": "OneStepGaRecognizer PoseRecognizer",
    "systems.vision.target_motion_estimator": "EstimatorParameters TargetMotionEstimator",
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
