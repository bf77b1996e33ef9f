"""Records what a scenario's cameras see, for `track` and for others."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.cameras import MakeMounts, MakeRig
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose, ReadScenarioMesh
from mffdrake.recognition.parameters import plain
from mffdrake.recognition.parameters.yaml_text import DumpYaml
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import RemoveNumbered, SaveImage
from mffdrake.recognition.recordings.rig_file import DumpRig
from mffdrake.recognition.recordings.trajectory import SaveTrajectory, Trajectory

__all__ = ["Record", "TrackCommand"]


def Record(
    scenario: Scenario,
    folder: Path,
    *,
    on_frame: Callable[[float, float], None] | None = None,
) -> SimulationResult:
    """Runs a scenario and writes what its cameras see and how they move.

    The recording is

    - ``images/right/000000.png`` and so on, a folder for each camera;
    - ``rig.yaml``: the cameras;
    - ``motion.tum``: the rig's pose in the world at every frame, as the motion feedforward knows
      it; without feedforward as it is;
    - ``true_poses.tum`` and ``live_poses.tum``: the target's true pose in the rig's frame, and the
      one that was recognized while recording;
    - ``start.tum``: the pose that a start near the target is drawn around;
    - ``target.obj`` and ``target.mtl``: the target's mesh with its colors;
    - ``scenario.yaml``, and of it ``recognizer.yaml``, for `track`.

    Args:
        scenario: What to simulate.
        folder: Where to write; it must exist.
        on_frame: Called after every frame with its simulated time and the wall time so far [s].

    Returns:
        The simulation's record.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        OSError: When the files cannot be written.
    """
    # First, as it may fail, and the simulation may take long.
    mesh, materials = ReadScenarioMesh(scenario).as_obj("target.mtl")
    for name, text in (("target.mtl", materials), ("target.obj", mesh)):
        with WholeFile(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    diagram = MakeHandEyeDiagram(scenario)
    rig = diagram.GetSubsystemByName("recognizer").tracker.rig
    for name in rig.names:
        (folder / "images" / name).mkdir(parents=True, exist_ok=True)
    displacements: list[RigidTransform] = []

    def OnExposure(context: Context) -> None:
        for name in rig.names:
            port = diagram.GetOutputPort(f"stereo_camera.color_image_{name}")
            image = port.Eval(context).data[:, :, :3]
            SaveImage(image, folder / "images" / name / f"{len(displacements):06d}.png")
        displacements.append(_Displacement(diagram, context))

    result = Simulate(scenario, diagram=diagram, on_frame=on_frame, on_exposure=OnExposure)
    for name in rig.names:  # of a longer recording that was here
        RemoveNumbered(folder / "images" / name, start=len(displacements))
    for name, poses in (
        ("motion", _Motion(scenario, result, displacements)),
        ("true_poses", result.true_pose),
        ("live_poses", result.recognized_pose),
        ("start", CalcDesiredPose(scenario, 0.0)[None]),
    ):
        SaveTrajectory(Trajectory(result.time[: len(poses)], poses), folder / f"{name}.tum")
    for name, text in (
        ("rig.yaml", DumpRig(rig)),
        ("scenario.yaml", scenario.Dump()),
        ("recognizer.yaml", DumpYaml(plain(scenario.recognizer))),
    ):
        with WholeFile(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    return result


def TrackCommand(scenario: Scenario, folder: Path) -> str:
    """The command that tracks a recording as it was tracked while recording.

    Args:
        scenario: What was recorded.
        folder: Where.

    Example:
        >>> print(TrackCommand(Scenario(method="ga"), Path("rec")).partition(" --images")[0])
        mffdrake track --rig rec/rig.yaml --target rec/target.obj
    """
    words = ["mffdrake", "track", "--rig", f"{folder}/rig.yaml", "--target"]
    words += [f"{folder}/target.obj", "--images"]
    words += [f"{name}={folder}/images/{name}" for name in MakeRig(scenario).names]
    if scenario.method == "mff":
        words += ["--motion", f"{folder}/motion.tum"]
    else:
        words += ["--rate", repr(1.0 / scenario.timing.vision_period)]
    if scenario.recognizer.start == "near_target":
        words += ["--start", f"{folder}/start.tum"]
    words += ["--recognizer", f"{folder}/recognizer.yaml", "--seed", str(scenario.seed)]
    return shlex.join([*words, "--out", f"{folder}/tracked"])


def _Displacement(diagram: Diagram, context: Context) -> RigidTransform:
    """The last frame's camera in the present one's, as the feedforward knows it."""
    if not diagram.HasSubsystemNamed("predictor"):
        return RigidTransform()
    predictor = diagram.GetSubsystemByName("predictor")
    port = predictor.GetOutputPort("camera_displacement")
    # A copy: Drake will write the next frame's to the same place.
    return RigidTransform(port.Eval(predictor.GetMyContextFromRoot(context)))


def _Motion(
    scenario: Scenario, result: SimulationResult, displacements: Sequence[RigidTransform]
) -> NDArray[np.float64]:
    """Pose vectors of the rig in the world at every frame, shape (K, 6)."""
    latency = MakeMounts(scenario)[0].latency
    R_CM, p_CM = transform_from_pose(result.true_pose)
    true = [
        scenario.target.CalcPose(time - latency) @ RigidTransform(RotationMatrix(R), p).inverse()
        for time, R, p in zip(result.time, R_CM, p_CM, strict=True)
    ]
    poses = true
    if scenario.method == "mff":
        poses = true[:1]
        for X_DC in displacements[1:]:
            poses.append(poses[-1] @ X_DC.inverse())
    return np.array([pose_from_transform(X.rotation().matrix(), X.translation()) for X in poses])
