"""Runs one simulation and records it."""

from __future__ import annotations

import dataclasses as dc
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.poses import CalcTruePoses
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.solid.symmetry import NO_SYMMETRIES, find_symmetries
from mffdrake.systems.lifetime import UseDiagram

__all__ = ["STAGES", "Simulate", "SimulationResult"]

Array = NDArray[np.float64]

_PIECE = 1 << 18  # rows: two and a half hours
STAGES = ("render", "recognition", "prediction", "total")
"""Whose wall time is measured; the total includes dynamics and control."""
_RECOGNIZED = ("pose", "fitness", "state", "confidence", "is_tracking")


@dc.dataclass(kw_only=True)
class SimulationResult:
    """What happened at every frame k of a simulation, K frames in all.

    Attributes:
        scenario: The scenario as YAML.
        time: Time of each frame [s], shape (K,).
        true_pose: Target's pose vector ``(r [m], eps)`` in the first camera C when the frame's
            images were exposed, shape (K, 6).
        recognized_pose: The pose recognized from that frame's images; of those that look the same,
            as the target is symmetric, the one nearest to the true pose, shape (K, 6).
        fitness: Its fitness, 0 to 1, shape (K,).
        state: What the tracker says of it, a number of `TrackingState`, shape (K,).
        confidence: Probability that it is right to 5 mm and 1 deg, NaN where the tracker does not
            tell it, shape (K,).
        is_tracking: 1 where the tracker relies on it, else 0, shape (K,).
        desired_hand_pose: Pose vector of the desired hand in the first hand frame E0, shape (K, 6).
        actual_hand_pose: The same of the actual hand, shape (K, 6).
        joint_positions: Arm's n joint angles [rad], shape (K, n).
        joint_velocities: Their rates [rad/s], shape (K, n).
        stages_ms: Mean wall time a frame of the stages "render", "recognition", "prediction" and
            "total" (which includes the dynamics and the control of one frame) [ms].
        wall_s: Wall time of the simulation [s], without building the diagram and loading the
            compiled kernels.
        symmetries: Those of the target, in words.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> file = Path(tempfile.mkdtemp()) / "result.npz"
        >>> short = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> Simulate(short).Save(file)
        >>> SimulationResult.Load(file).recognized_pose.shape
        (4, 6)
    """

    scenario: str
    time: Array
    true_pose: Array
    recognized_pose: Array
    fitness: Array
    state: Array
    confidence: Array
    is_tracking: Array
    desired_hand_pose: Array
    actual_hand_pose: Array
    joint_positions: Array
    joint_velocities: Array
    stages_ms: dict[str, float]
    wall_s: float
    symmetries: str = "none"

    def Save(self, path: Path | str) -> None:
        """Writes everything as an NPZ file, whole or not at all."""
        values = {field.name: getattr(self, field.name) for field in dc.fields(self)}
        stages = values.pop("stages_ms")
        names, means = np.array(list(stages)), np.array(list(stages.values()))
        # A file, not a name: NumPy would append a suffix to a name that lacks it.
        with WholeFile(path) as part, part.open("wb") as file:
            np.savez_compressed(file, stage_names=names, stage_means_ms=means, **values)

    @classmethod
    def Load(cls, path: Path | str) -> SimulationResult:
        """Reads what `Save` wrote.

        Raises:
            ValueError: When it is not such a file.
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                values = {name: data[name] for name in data.files}
        except (ValueError, TypeError, AttributeError) as error:
            raise ValueError(f"{path}: not a record written by SimulationResult.Save") from error
        names, means = (values.pop(key).tolist() for key in ("stage_names", "stage_means_ms"))
        stages = dict(zip(names, means, strict=True))
        values.update(scenario=str(values["scenario"]), wall_s=float(values["wall_s"]))
        values["symmetries"] = str(values.get("symmetries", "none"))
        for name in ("state", "confidence", "is_tracking"):  # Earlier versions did not record them.
            values.setdefault(name, np.full(len(values["time"]), np.nan))
        return cls(stages_ms=stages, **values)


def Simulate(
    scenario: Scenario,
    *,
    diagram: Diagram | None = None,
    on_frame: Callable[[float, float], bool | None] | None = None,
    on_exposure: Callable[[Context], None] | None = None,
) -> SimulationResult:
    """Runs a scenario from time 0 to its duration and records every frame.

    Args:
        scenario: What to simulate.
        diagram: The diagram of this very scenario, where it is built already.
        on_frame: Called after every frame with its simulated time and the wall time so far [s];
            when it returns True, the simulation ends there, its record that of a shorter scenario.
        on_exposure: Called at every frame with the diagram's context, just before the recognizer
            reads the images.

    Returns:
        The record.

    Raises:
        ScenarioError, UnreachablePathError, GraphicsUnavailableError: See `MakeHandEyeDiagram`.

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> result = Simulate(LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}"))
        >>> result.time
        array([0.   , 0.033, 0.066, 0.099])
    """
    if diagram is None:
        simulate = partial(Simulate, scenario, on_frame=on_frame, on_exposure=on_exposure)
        return UseDiagram(lambda: MakeHandEyeDiagram(scenario), lambda d: simulate(diagram=d))
    timing, simulator = diagram.GetSubsystemByName("recognizer").timing, Simulator(diagram)
    _WarmUp(diagram, simulator.get_context())
    recorder = _Recorder(scenario, diagram, simulator.get_mutable_context())
    for frame in range(timing.NumFrames(scenario.duration)):
        tick, next_tick = timing.TickOfFrame(frame), timing.TickOfFrame(frame + 1)
        # Events at this time run in the next step, so the state here is the one the frame shows.
        recorder.RecordTruth()
        if on_exposure is not None:
            on_exposure(simulator.get_context())
        recorder.Mark()
        simulator.AdvanceTo(timing.TimeOfTick(tick + 1))
        recorder.RecordRecognition()
        end = min(timing.TimeOfTick(next_tick), scenario.duration)
        # Advancing to the present time would run its events now, before the truth is noted.
        if end > timing.TimeOfTick(tick + 1):
            simulator.AdvanceTo(end)
        recorder.FinishFrame(next_tick - tick)
        told = min(scenario.timing.TimeOfTick(next_tick), scenario.duration)
        if on_frame is not None and on_frame(told, recorder.wall_s):
            return recorder.Result(dc.replace(scenario, duration=told))
    return recorder.Result(scenario)


def _WarmUp(diagram: Diagram, context: Context) -> None:
    """Renders once and loads the compiled kernels (the very first time, compiles them).

    That happens once a process and is no part of a frame's time.
    """
    tracker = diagram.GetSubsystemByName("recognizer").tracker
    images = [
        diagram.GetOutputPort(f"stereo_camera.color_image_{name}").Eval(context).data
        for name in tracker.rig.names
    ]
    tracker.track(tracker.start_population(images, frame=0), images, frame=1)


class _Rows:
    """Rows of numbers, for which memory is taken in large pieces: while it lasts, none grows.

    Args:
        most: How many rows there may be.
        sizes: How many numbers each column has in a row.
    """

    def __init__(self, most: int, sizes: Mapping[str, int]) -> None:
        columns = np.dtype([(name, float, (size,)) for name, size in sizes.items()])
        self._pieces = [np.full(min(most, _PIECE), np.nan, columns)]
        self._count = 0  # in the last piece

    def Add(self) -> np.void:
        """A new row, to be filled in."""
        if self._count == len(self._pieces[-1]):
            self._pieces.append(np.full_like(self._pieces[0], np.nan))
            self._count = 0
        self._count += 1
        row: np.void = self._pieces[-1][self._count - 1]
        return row

    def Columns(self) -> dict[str, Array]:
        """The rows' columns, shape (K, size); of single numbers, (K,)."""
        rows = np.concatenate([*self._pieces[:-1], self._pieces[-1][: self._count]])
        columns = {name: np.array(rows[name]) for name in rows.dtype.names or ()}
        return {name: x[:, 0] if x.shape[1] == 1 else x for name, x in columns.items()}


class _Recorder:
    """Collects the frames and the stages' wall times.

    It reads the images and the prediction just before the recognizer does. The recognizer then
    finds them computed (Drake caches them), so that each stage can be timed from outside; what is
    computed stays the same. What follows from the states is computed in the end.
    """

    def __init__(self, scenario: Scenario, diagram: Diagram, context: Context) -> None:
        self._diagram, self._context = diagram, context
        recognizer = diagram.GetSubsystemByName("recognizer")
        self._tracker, self._timing = recognizer.tracker, recognizer.timing
        self._before, self._after, self._images = (
            [(name, diagram.GetOutputPort(name)) for name in names]
            for names in (
                ("state", "exposed_state"),
                [f"recognizer.{name}" for name in _RECOGNIZED],
                [f"stereo_camera.color_image_{name}" for name in self._tracker.rig.names],
            )
        )
        self._predicted = None
        if diagram.HasSubsystemNamed("predictor"):
            predictor = diagram.GetSubsystemByName("predictor")
            self._predicted = (
                predictor.GetOutputPort("predicted_population"),
                predictor.GetMyContextFromRoot(context),
            )
        sizes = {name: port.size() for name, port in (*self._before, *self._after)}
        most = scenario.timing.NumFrames(scenario.duration)
        self._rows, self._row = _Rows(most, sizes), np.void(b"")
        self._stages_ms = dict.fromkeys(STAGES, 0.0)
        self._marks: list[float] = []
        self._start = time.perf_counter()

    @property
    def wall_s(self) -> float:
        """Wall time since the start [s]."""
        return time.perf_counter() - self._start

    def RecordTruth(self) -> None:
        """Notes the present state and computes what the recognizer is about to read."""
        self._marks = [time.perf_counter()]
        self._row = self._rows.Add()
        for name, port in self._before:
            self._row[name] = port.Eval(self._context)
        self._marks.append(time.perf_counter())
        for _, port in self._images:
            port.EvalAbstract(self._context)  # Eval would make an object of Python.
        self._marks.append(time.perf_counter())
        if self._predicted is not None:
            port, context = self._predicted
            port.Eval(context)
        self._marks.append(time.perf_counter())

    def Mark(self) -> None:
        """Notes that the frame goes on."""
        self._marks.append(time.perf_counter())

    def RecordRecognition(self) -> None:
        """Notes what the recognizer made of the frame, one tick later."""
        self._marks.append(time.perf_counter())
        for name, port in self._after:
            self._row[name] = port.Eval(self._context)

    def FinishFrame(self, ticks: int) -> None:
        """Notes the stages' times at the end of a frame."""
        begin, told, rendered, predicted, resumed, recognized = self._marks
        end = time.perf_counter()
        # The recognizer's tick also did what every tick does: control and dynamics.
        one_tick = (end - recognized) / max(1, ticks - 1)
        for name, seconds in (
            ("render", rendered - told),
            ("prediction", predicted - rendered),
            ("recognition", max(0.0, recognized - resumed - one_tick)),
            ("total", end - begin - (resumed - predicted)),
        ):
            self._stages_ms[name] += 1e3 * seconds

    def Result(self, scenario: Scenario) -> SimulationResult:
        """The record, of a scenario as long as it was simulated."""
        rows = self._rows.Columns()
        states = rows.pop("state")
        frames = range(len(states))
        times = np.array([*map(self._timing.TimeOfFrame, frames)])
        true, actual, desired = CalcTruePoses(
            scenario, self._diagram, times, states, rows.pop("exposed_state")
        )
        recognized = {name.removeprefix("recognizer."): rows.pop(name) for name, _ in self._after}
        matcher = getattr(self._tracker, "matcher", None)  # Others keep what they know.
        symmetries = find_symmetries(matcher.solid) if matcher else NO_SYMMETRIES
        nearest = map(symmetries.nearest, recognized.pop("pose"), true)
        num_joints = self._diagram.GetSubsystemByName("plant").num_positions()
        return SimulationResult(
            scenario=scenario.Dump(),
            time=np.array([*map(scenario.timing.TimeOfFrame, frames)]),
            true_pose=true,
            recognized_pose=np.array(list(nearest)).reshape(-1, 6),
            desired_hand_pose=desired,
            actual_hand_pose=actual,
            joint_positions=states[:, :num_joints],
            joint_velocities=states[:, num_joints:],
            stages_ms={name: ms / len(states) for name, ms in self._stages_ms.items()},
            symmetries=str(symmetries),
            wall_s=self.wall_s,
            **recognized,
        )
