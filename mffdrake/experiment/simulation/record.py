"""Records what a scenario's cameras see, for `track` and for others."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
from mffdrake.recognition import CameraRig
from mffdrake.recognition.parameters import plain
from mffdrake.recognition.parameters.yaml_text import DumpYaml
from mffdrake.recognition.poses.pose import pose_from_transform, transform_from_pose
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import RemoveNumbered, SaveImage
from mffdrake.recognition.recordings.rig_file import DumpRig
from mffdrake.recognition.recordings.trajectory import SaveTrajectory, Trajectory
from mffdrake.recognition.ros.mcap_file import RigRecorder, write_mcap

__all__ = ["Record", "TrackCommand"]


def Record(
    scenario: Scenario,
    folder: Path,
    *,
    mcap: Path | None = None,
    on_frame: Callable[[float, float], None] | None = None,
) -> SimulationResult:
    """Runs a scenario and writes what its cameras see and how they move.

    The recording is

    - ``images/right/000000.png`` and so on, a folder for each camera; or, in their place, the MCAP
      file, which also has the cameras, the motion and the true poses, see `RigRecorder`;
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
        mcap: The MCAP file; None for folders of images.
        on_frame: Called after every frame with its simulated time and the wall time so far [s].

    Returns:
        The simulation's record.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.
        RosError: When an MCAP file is wanted and its libraries are not installed.
        OSError: When the files cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> folder = Path(tempfile.mkdtemp())
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> result = Record(short, folder)
        >>> sorted(file.name for file in (folder / "images" / "left").iterdir())[-1]
        '000003.png'
    """
    # First, as it may fail, and the simulation may take long.
    mesh, materials = ReadScenarioMesh(scenario).as_obj("target.mtl")
    for name, text in (("target.mtl", materials), ("target.obj", mesh)):
        with WholeFile(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    diagram = MakeHandEyeDiagram(scenario)
    rig = diagram.GetSubsystemByName("recognizer").tracker.rig
    displacements: list[RigidTransform] = []

    with _Sink(scenario, rig, folder, mcap) as (save, save_rest):

        def OnExposure(context: Context) -> None:
            ports = [diagram.GetOutputPort(f"stereo_camera.color_image_{n}") for n in rig.names]
            images = [port.Eval(context).data[:, :, :3] for port in ports]
            save(len(displacements), context.get_time(), images)
            displacements.append(_Displacement(diagram, context))

        result = Simulate(scenario, diagram=diagram, on_frame=on_frame, on_exposure=OnExposure)
        motion = Trajectory(
            result.time[: len(displacements)], _Motion(scenario, result, displacements)
        )
        save_rest(motion, Trajectory(result.time, result.true_pose))
    for name, poses in (
        ("motion", motion.poses),
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


_Save = Callable[[int, float, Sequence[NDArray[np.uint8]]], None]
_SaveRest = Callable[[Trajectory, Trajectory], None]


@contextmanager
def _Sink(
    scenario: Scenario, rig: CameraRig, folder: Path, mcap: Path | None
) -> Iterator[tuple[_Save, _SaveRest]]:
    """Where images go, and at the end motion and true poses."""
    if mcap is not None:
        with write_mcap(mcap) as file:
            recorder = RigRecorder(file, rig, [mount.latency for mount in MakeMounts(scenario)])

            def SaveAll(motion: Trajectory, true_poses: Trajectory) -> None:
                recorder.add_motion(motion)
                recorder.add_true_poses(true_poses)

            yield (lambda frame, time, images: recorder.add_images(time, images)), SaveAll
        return
    for name in rig.names:
        (folder / "images" / name).mkdir(parents=True, exist_ok=True)

    def SaveImages(frame: int, time: float, images: Sequence[NDArray[np.uint8]]) -> None:
        for name, image in zip(rig.names, images, strict=True):
            SaveImage(image, folder / "images" / name / f"{frame:06d}.png")

    def RemoveOlder(motion: Trajectory, true_poses: Trajectory) -> None:
        for name in rig.names:  # of a longer recording that was here
            RemoveNumbered(folder / "images" / name, start=len(motion))

    yield SaveImages, RemoveOlder


def TrackCommand(scenario: Scenario, folder: Path, mcap: Path | None = None) -> str:
    """The command that tracks a recording as it was tracked while recording.

    Args:
        scenario: What was recorded.
        folder: Where.
        mcap: The MCAP file, where there is one.

    Example:
        >>> print(TrackCommand(Scenario(method="ga"), Path("rec")).partition(" --images")[0])
        mffdrake track --rig rec/rig.yaml --target rec/target.obj
    """
    words = ["mffdrake", "track", "--rig", f"{folder}/rig.yaml", "--target"]
    words += [f"{folder}/target.obj"]
    with_motion = scenario.method == "mff"
    if mcap is not None:
        words += ["--recording", str(mcap), *(() if with_motion else ("--motion", "none"))]
    else:
        words += ["--images"]
        words += [f"{name}={folder}/images/{name}" for name in MakeRig(scenario).names]
        if with_motion:
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
