"""What ``mffdrake track`` does."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses as dc
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.commands.one import WatchTracking
from mffdrake.experiment.commands.options.arguments import (
    ArgumentsError,
    ImagesByCamera,
    LoadTarget,
)
from mffdrake.experiment.progress import ProgressBar, TellCompiling
from mffdrake.experiment.runs.table import WriteJson, WriteRows
from mffdrake.experiment.simulation.plotting import PlotTrack, SaveFigure
from mffdrake.recognition import CameraRig, PoseTracker, Refinement, SearchRange, TrackerParameters
from mffdrake.recognition.genetic.genetic import POSE_COORDINATES
from mffdrake.recognition.recordings.color_file import LoadColors
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.recognition.recordings.image_files import OpenImages, SaveImage
from mffdrake.recognition.recordings.overlay import MakeOverlay
from mffdrake.recognition.recordings.recording import (
    MotionWarning,
    Recording,
    TrackedFrame,
    TrackRecording,
    ViewWarning,
)
from mffdrake.recognition.recordings.rig_file import LoadRig
from mffdrake.recognition.recordings.trajectory import (
    LoadPose,
    LoadTrajectory,
    SaveTrajectory,
    Trajectory,
)
from mffdrake.recognition.refinement.outcome import Outcome
from mffdrake.recognition.ros.mcap_file import write_poses
from mffdrake.recognition.ros.messages import nanoseconds, rig_frame, typestore
from mffdrake.recognition.ros.ros_recording import RosRecording, open_recording
from mffdrake.recognition.visibility.outline import DrawViews

__all__ = ["RunTrack"]

_log = logging.getLogger("mffdrake")

_WHEN_WRONG = 'What may be the matter: "When it goes wrong" in docs/studies/real_images.md.'


def RunTrack(options: argparse.Namespace) -> int:
    """Tracks a solid through images, writes its poses and tells what came out."""
    if options.mcap_out is not None:
        typestore()  # Find out now whether its libraries are there.
    rig, recording = _OpenRecording(options)
    tracker = _MakeTracker(options, rig)
    matcher = tracker.ga.matcher
    folder = MakeOutputFolder(options.out)
    tracked: list[TrackedFrame] = []
    watch = WatchTracking(tracker, options) if options.meshcat else None
    try:
        with (
            _Bars(recording.count, options.generations) as (on_frame, on_generation),
            MakeOverlay(options.overlay, folder, recording.rate / options.stride) as add_overlay,
        ):
            frames = TrackRecording(
                tracker, recording,
                generations=options.generations, on_generation=on_generation,
            )  # fmt: skip
            for frame in frames:
                estimate = frame.estimate
                if options.overlay is not None:
                    add_overlay(
                        frame.recorded.frame,
                        DrawViews(frame.recorded.images, estimate.pose, matcher.solid, matcher.rig),
                    )
                tracked.append(frame)
                # Images are large: only the last frame's are kept.
                if len(tracked) > 1:
                    tracked[-2] = tracked[-2].WithoutImages()
                on_frame(estimate.fitness)
                if watch is not None:
                    watch(frame)
    finally:
        if tracked:
            refinement = _Write(tracked, tracker, options, folder)
            if options.mcap_out is not None:
                _WriteMcap(tracked, recording, options.mcap_out)
    if isinstance(recording, RosRecording):
        print(f"Recording: {recording.summary}.")
    _Tell(tracked, refinement, tracker, folder)
    for warning in (MotionWarning(tracked, tracker.ga.sure_fitness), ViewWarning(tracked, rig)):
        if warning is not None:
            _log.warning("%s", warning)
    return 0


def _OpenRecording(options: argparse.Namespace) -> tuple[CameraRig, Recording | RosRecording]:
    """The cameras and their images."""
    given = ImagesByCamera("NAME=SOURCE", options.images)
    rig = None if options.rig is None else LoadRig(options.rig)
    motion: Any = options.motion
    if options.recording is not None:
        if motion not in (None, "none") and (_IsFile(motion) or not motion.startswith("/")):
            motion = LoadTrajectory(motion)
        found = open_recording(
            options.recording, rig=rig, images=given, motion=motion,
            stride=options.stride, rate=options.rate,
        )  # fmt: skip
        if found.warning:
            _log.warning("%s", found.warning)
        return found.rig, found
    if rig is None or not given:
        raise ArgumentsError("give --rig and --images, or a --recording, which may bring both")
    recording = Recording(
        rig=rig,
        sources={name: OpenImages(source) for name, source in given.items()},
        motion=None if options.motion is None else LoadTrajectory(options.motion),
        stride=options.stride,
        rate=options.rate,
    )
    return rig, recording


def _WriteMcap(tracked: list[TrackedFrame], recording: Recording | RosRecording, path: str) -> None:
    """Writes the poses as messages."""
    stamps = [
        nanoseconds(f.recorded.time) if f.recorded.stamp is None else f.recorded.stamp
        for f in tracked
    ]
    frame = recording.frame if isinstance(recording, RosRecording) else rig_frame(recording.rig)
    write_poses(path, frame, stamps, [f.estimate for f in tracked])


def _MakeTracker(options: argparse.Namespace, rig: CameraRig) -> PoseTracker:
    """The tracker that the options describe."""
    solid = LoadTarget(options.target)
    colors = None if options.colors is None else LoadColors(options.colors)
    config = _ReadRecognizer(options.recognizer or "{}", TrackerParameters.in_view(rig, solid))
    start_pose = np.zeros(6)
    if options.start == "random":
        config = dc.replace(config, start="random")
    elif options.start is not None:
        config, start_pose = dc.replace(config, start="near_target"), LoadPose(options.start)
        _CheckStart(start_pose, config.search_range, options.start)
    elif config.start == "near_target":
        raise ArgumentsError("recognizer.start near_target: --start must name a file with a pose")
    if options.generations is not None and options.start not in (None, "random"):
        raise ArgumentsError("--generations searches from nothing: leave --start out")
    try:
        tracker = PoseTracker(
            config.make_tracker(
                solid=solid, rig=rig, seed=options.seed, start_pose=start_pose, colors=colors
            )
        )
    except ValueError as error:
        raise ArgumentsError(f"{options.colors or options.target}: {error}") from error
    search_range = tracker.ga.coding.search_range
    middle = 0.5 * (search_range.lower + search_range.upper)[:3]
    if not any(np.isfinite(camera.project(middle)).all() for camera in rig.cameras):
        _log.warning(
            "no camera looks toward the middle of the search range, %s m in the rig's frame; set "
            "it by --recognizer '{search_range: {x: [least, greatest], ...}}'",
            np.round(middle, 3).tolist(),
        )
    return tracker


def _CheckStart(pose: NDArray[np.float64], search_range: SearchRange, name: str) -> None:
    """Refuses a start that the genes cannot tell."""
    outside = np.flatnonzero((pose < search_range.lower) | (pose > search_range.upper))
    if len(outside):
        coordinate = POSE_COORDINATES[outside[0]]
        bounds = [round(bound, 4) for bound in getattr(search_range, coordinate)]
        raise ArgumentsError(
            f"--start {name}: {coordinate} = {pose[outside[0]]:.4g} is outside the search range "
            f"{bounds}; widen it by --recognizer "
            f"'{{search_range: {{{coordinate}: [least, greatest]}}}}'"
        )


def _ReadRecognizer(given: str, default: TrackerParameters) -> TrackerParameters:
    """The section of a scenario, from a file or from YAML."""
    if _IsFile(given):
        try:
            return TrackerParameters.read(Path(given).read_text(encoding="utf-8"), default)
        except ValueError as error:
            text = "not a text file in UTF-8" if isinstance(error, UnicodeError) else str(error)
            raise ArgumentsError(f"{given}: {text}") from error
    if not set(given) & set(":{"):
        raise ArgumentsError(
            f"--recognizer {given}: no such file, and no YAML such as '{{refinement: borders}}'"
        )
    return TrackerParameters.read(given, default)


def _IsFile(text: str) -> bool:
    """Whether a text is a file's name; YAML may be longer than names are."""
    with contextlib.suppress(OSError):
        return Path(text).is_file()
    return False


def _Write(
    tracked: list[TrackedFrame],
    tracker: PoseTracker,
    options: argparse.Namespace,
    folder: Path,
) -> Refinement:
    """Writes what was tracked; returns what the refinement says of the last pose."""
    WriteRows([frame.Row() for frame in tracked], folder / "poses.csv")
    times = np.array([frame.recorded.time for frame in tracked])
    poses = np.array([frame.estimate.pose for frame in tracked])
    SaveTrajectory(Trajectory(times, poses), folder / "poses.tum")
    last, refinement = tracked[-1], _LastRefinement(tracked[-1], tracker)
    data = {
        "settings": {k: v for k, v in vars(options).items() if k not in ("command", "verbose")},
        "frames": len(tracked),
        "means": {
            "fitness": float(np.mean([frame.estimate.fitness for frame in tracked])),
            "refined": float(np.mean([frame.estimate.refined for frame in tracked])),
            "is_tracking": float(np.mean([frame.estimate.is_tracking for frame in tracked])),
            "ms": float(np.mean([frame.ms for frame in tracked])),
        },
        "search": _Search(tracked[0]),
        "last_refinement": {
            "refined": last.estimate.refined,
            "reason": "" if last.estimate.refined else refinement.reason,
            "num_borders": refinement.num_borders,
            "explained": refinement.explained,
            "residual_px": _Number(refinement.residual),
            "expected_residual_px": _Number(refinement.expected_residual),
        },
    }
    WriteJson(data, folder / "track.json")
    matcher = tracker.ga.matcher
    views = DrawViews(last.recorded.images, last.estimate.pose, matcher.solid, matcher.rig)
    SaveImage(views, folder / "last_frame.png")
    if len(tracked) > 1:
        fitness = np.array([frame.estimate.fitness for frame in tracked])
        SaveFigure(PlotTrack(times, poses, fitness), folder / "poses.png")
    return refinement


def _Search(first: TrackedFrame) -> dict[str, Any] | None:
    """How the first frame was searched."""
    if first.found is None:
        return None
    return {
        "generations": first.found.num_generations,
        "rounds": first.found.num_rounds,
        "converged": first.found.converged,
    }


def _LastRefinement(last: TrackedFrame, tracker: PoseTracker) -> Refinement:
    """What the refinement says of the last frame's pose."""
    assert tracker.generation is not None
    scene = tracker.ga.matcher.scene(last.recorded.images, tracker.generation.gains)
    return tracker.ga.refiner.refine_scene(last.estimate.pose, scene)


def _Number(value: float) -> float | None:
    """A number that JSON knows."""
    return value if np.isfinite(value) else None


def _Tell(
    tracked: list[TrackedFrame], refinement: Refinement, tracker: PoseTracker, folder: Path
) -> None:
    """Prints the last pose and where everything is."""
    last = tracked[-1]
    row = last.Row()
    numbers = ", ".join(f"{row[key]:.4f}" for key in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    print(
        f"{len(tracked)} frame{'s' * (len(tracked) > 1)}; the last pose, x y z [m] and quaternion"
    )
    print(f"qx qy qz qw in the rig's frame: {numbers}")
    refined = f"not refined: {_WhyUnrefined(refinement, tracker.ga.rig)}"
    if last.estimate.refined:
        refined = (
            f"refined, give or take {row['std_position_mm']:.2f} mm and "
            f"{row['std_rotation_deg']:.2f} deg"
        )
    print(f"Fitness {row['fitness']:.3f}, {refined}.")
    relied = sum(frame.estimate.is_tracking for frame in tracked)
    hint = "" if 2 * relied >= len(tracked) else f" {_WHEN_WRONG}"
    print(f"Relied on (is_tracking) in {relied} of {len(tracked)} frames.{hint}")
    found = tracked[0].found
    if found is not None:
        how = "converged" if found.converged else "not converged: more --generations may help"
        print(f"Search: {found.num_generations} generations in {found.num_rounds} rounds, {how}.")
    print(f"Results and pictures: {folder}/")


def _WhyUnrefined(refinement: Refinement, rig: CameraRig) -> str:
    """The reason, and what a person may do about it."""
    if refinement.outcome == Outcome.OFF:
        return "that is off (--recognizer), so that is_tracking tells of a high fitness alone"
    largest = max(camera.calibration_error for camera in rig.cameras)
    if refinement.outcome == Outcome.UNCERTAIN and largest > 0.0:
        return (
            f"{refinement.reason}; the cameras may be off by {largest:g} px (calibration_error in "
            "the rig file: give what your calibration really leaves)"
        )
    return refinement.reason


@contextmanager
def _Bars(
    count: int | None, generations: int | None
) -> Iterator[tuple[Callable[[float], None], Callable[[int, float], None]]]:
    """Bars over frames and over a search's generations."""
    with (
        TellCompiling(),
        ProgressBar(
            total=generations, desc="search", unit="gen", leave=False, disable=generations is None
        ) as search,
        ProgressBar(total=count, desc="frames", unit="frame") as bar,
    ):  # fmt: skip

        def OnFrame(fitness: float) -> None:
            bar.set_postfix_str(f"fitness {fitness:.2f}", refresh=False)
            bar.update(1)

        def OnGeneration(number: int, fitness: float) -> None:
            search.set_postfix_str(f"fitness {fitness:.2f}", refresh=False)
            search.update(number - search.n)

        yield OnFrame, OnGeneration
