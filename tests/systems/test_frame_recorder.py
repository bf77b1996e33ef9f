"""One row a frame: the result of that frame, and the signals as they were at its time."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, TrajectorySource
from pydrake.systems.sensors import ImageRgba8U
from pydrake.trajectories import PiecewisePolynomial
from stand_in import StandIn

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    CameraRig,
    Matcher,
    OneStepGaTracker,
    SearchModel,
    SolidModel,
)
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.frame_recorder import FrameRecorder
from mffdrake.systems.vision.recognizer import OneStepGaRecognizer

TIMINGS = {
    "33 ms": Timing(),
    "30 Hz": Timing(vision_period=1 / 30),
    "7.3 ms": Timing(control_period=0.002, vision_period=0.0073),
    "every tick": Timing(vision_period=0.001),
}
LINES = {
    "clock": PiecewisePolynomial.FirstOrderHold([0.0, 10.0], np.array([[0.0, 10.0]])),
    "state": PiecewisePolynomial.FirstOrderHold([0.0, 10.0], np.array([[5.0, 15.0], [0.0, -20.0]])),
}
"""Signals that tell the time."""


def build(recognizer, **arguments):
    """A simulator and the recorder of a recognizer and of those signals."""
    builder = DiagramBuilder()
    builder.AddSystem(recognizer)
    signals = {
        name: builder.AddSystem(TrajectorySource(line)).get_output_port()
        for name, line in LINES.items()
    }
    recorder = FrameRecorder.AddToBuilder(builder, recognizer, signals, **arguments)
    return Simulator(builder.Build()), recorder


def assert_complete(frames, timing, count, latency=0.0):
    """Whether these are the stand-in's frames from the first on, with their signals."""
    k = np.arange(count)
    times = np.array([timing.TimeOfFrame(frame) for frame in range(count)])
    exposed = np.where(times - latency > -1e-9, times - latency, np.nan)
    assert set(frames) == {"frame_time", "pose", "fitness", "pose_covariance", "clock", "state"}
    np.testing.assert_array_equal(frames["frame_time"], times)
    np.testing.assert_array_equal(frames["pose"], np.tile(k[:, None], 6))
    np.testing.assert_array_equal(frames["fitness"], 1.0 / (1.0 + k))
    covariance = k[:, None, None] + np.arange(36.0).reshape(6, 6)
    np.testing.assert_array_equal(frames["pose_covariance"], covariance)
    np.testing.assert_allclose(frames["clock"], exposed[:, None], atol=1e-12)
    expected = np.column_stack([5.0 + exposed, -2.0 * exposed])
    np.testing.assert_allclose(frames["state"], expected, atol=1e-12)


@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_each_frame_has_one_row_with_the_signals_of_its_time(timing):
    simulator, recorder = build(StandIn(timing=timing))
    simulator.AdvanceTo(0.25)
    assert_complete(recorder.FindFrames(simulator.get_context()), timing, timing.NumFrames(0.25))


@pytest.mark.parametrize("frames", [0.1, 1.0, 1.7, 4.0])
@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_with_a_latency_the_signals_are_those_of_the_exposures(timing, frames):
    latency = timing.TimeOfTick(round(frames * timing.vision_period / timing.control_period))
    simulator, recorder = build(StandIn(timing=timing), latency=latency)
    simulator.AdvanceTo(0.25)
    assert_complete(
        recorder.FindFrames(simulator.get_context()), timing, timing.NumFrames(0.25), latency
    )


@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_in_whatever_chunks_a_simulation_advances_each_frame_has_one_row(timing):
    rng = np.random.default_rng(0)
    simulator, recorder = build(StandIn(timing=timing))
    context = simulator.get_context()
    for _ in range(60):
        time = context.get_time()
        # Odd times, and the very times of ticks and of frames, before and after their events.
        simulator.AdvanceTo(
            rng.choice(
                [
                    time + rng.uniform(0.0, 0.02),
                    timing.TimeOfTick(timing.Tick(time) + 1),
                    timing.TimeOfFrame(timing.FrameAt(time) + 1),
                ]
            )
        )
        if rng.random() < 0.3:
            simulator.AdvancePendingEvents()
        count = len(recorder.FindFrames(context)["frame_time"])
        now = context.get_time()
        # A frame at this very time has its row as soon as its events have run.
        assert count in (timing.NumFrames(now), timing.FrameAt(now) + 1)
        assert_complete(recorder.FindFrames(context), timing, count)
    simulator.AdvanceTo(context.get_time() + timing.control_period)
    end = context.get_time()
    assert_complete(recorder.FindFrames(context), timing, timing.NumFrames(end))


def test_a_frames_row_is_there_once_the_simulation_is_past_its_time():
    simulator, recorder = build(StandIn())
    context = simulator.get_context()
    for end, count in ((0.0330, 1), (0.0331, 2), (0.0659, 2), (0.0660, 2), (0.06601, 3)):
        simulator.AdvanceTo(end)
        assert len(recorder.FindFrames(context)["frame_time"]) == count


def test_two_contexts_share_no_rows():
    simulator, recorder = build(StandIn())
    simulator.AdvanceTo(0.1)
    first = simulator.get_context()
    copy = first.Clone()
    simulator.AdvanceTo(0.2)
    assert_complete(recorder.FindFrames(first), Timing(), 7)
    assert_complete(recorder.FindFrames(copy), Timing(), 4)
    Simulator(simulator.get_system(), copy).AdvanceTo(0.3)
    assert_complete(recorder.FindFrames(first), Timing(), 7)
    fresh = simulator.get_system().CreateDefaultContext()
    assert_complete(recorder.FindFrames(fresh), Timing(), 0)


def test_a_real_recognizers_frames():
    box = SolidModel.box((0.100, 0.150, 0.200), (RED, GREEN, BLUE))
    rig = CameraRig.stereo(width=64, height=48, focal_length=60.0, baseline=0.150)
    timing = Timing(vision_period=1 / 30)
    recognizer = OneStepGaRecognizer(
        tracker=OneStepGaTracker(matcher=Matcher(SearchModel(box), rig)), timing=timing
    )
    builder = DiagramBuilder()
    builder.AddSystem(recognizer)
    image = builder.AddSystem(ConstantValueSource(AbstractValue.Make(ImageRgba8U(64, 48))))
    for name in rig.names:
        builder.Connect(image.get_output_port(), recognizer.GetInputPort(f"color_image_{name}"))
    clock = builder.AddSystem(TrajectorySource(LINES["clock"]))
    recorder = FrameRecorder.AddToBuilder(
        builder, recognizer, {"clock": clock.get_output_port()}, name="log"
    )
    simulator = Simulator(builder.Build())
    context = recognizer.GetMyContextFromRoot(simulator.get_context())
    poses = []
    for frame in range(5):
        simulator.AdvanceTo(timing.TimeOfFrame(frame) + timing.control_period)
        poses.append(recognizer.GetOutputPort("pose").Eval(context).copy())
    frames = recorder.FindFrames(simulator.get_context())
    assert recorder.get_name() == "log"
    np.testing.assert_array_equal(frames["pose"], poses)
    np.testing.assert_array_equal(1000 * frames["frame_time"], [0, 33, 67, 100, 133])
    np.testing.assert_allclose(frames["clock"][:, 0], frames["frame_time"], atol=1e-12)
    assert np.all(np.isnan(frames["pose_covariance"]))


def test_without_signals_there_are_the_results():
    builder = DiagramBuilder()
    recognizer = builder.AddSystem(StandIn())
    recorder = FrameRecorder.AddToBuilder(builder, recognizer, {})
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.1)
    frames = recorder.FindFrames(simulator.get_context())
    np.testing.assert_array_equal(frames["pose"][:, 0], range(4))


def test_another_timing_than_the_recognizers_is_told():
    builder = DiagramBuilder()
    recognizer = builder.AddSystem(StandIn(timing=Timing(vision_period=0.030)))
    recorder = builder.AddNamedSystem("log", FrameRecorder(signals={}))
    for name in ("frame_time", "pose", "fitness", "pose_covariance"):
        builder.Connect(recognizer.GetOutputPort(name), recorder.GetInputPort(name))
    message = (
        r"log: the recognizer's last frame \('frame_time'\) was at 0.03 s, but this system's at 0 s"
        ", with a frame every 0.033 s; give both the same timing"
    )
    with pytest.raises(RuntimeError, match=message):
        Simulator(builder.Build()).AdvanceTo(0.1)


@pytest.mark.parametrize("name", ["frame_time", "pose", "fitness", "pose_covariance"])
def test_a_signal_needs_a_name_of_its_own(name):
    with pytest.raises(ValueError, match=f"another name than .* not '{name}'; rename it"):
        FrameRecorder(signals={name: 1})


def test_the_latency_is_whole_control_ticks():
    with pytest.raises(ValueError, match="latency must be at least 0 and a whole multiple"):
        FrameRecorder(signals={}, latency=0.0005)
