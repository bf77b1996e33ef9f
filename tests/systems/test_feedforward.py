"""A predictor predicts its tracker's own frames, or says that it does not."""

import re

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from stand_in import StandIn

from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.feedforward import ConnectFeedforward
from mffdrake.systems.vision.predictor import MffPredictor

ARM = MakePa10Plant()
KNOTS = np.linspace(0.0, 1.0, 11)
JOINTS = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
    KNOTS, NOMINAL_POSITIONS[:, None] + np.random.default_rng(0).uniform(-0.2, 0.2, (7, 11))
)
"""Random joint motion."""
TIMINGS = {
    "33 ms": Timing(),
    "30 Hz": Timing(vision_period=1 / 30),
    "60 Hz": Timing(vision_period=1 / 60),
    "7.3 ms": Timing(control_period=0.002, vision_period=0.0073),
}
DEFAULT = Timing()


class Loop:
    """A tracker that moves nothing, its predictor and a moving arm."""

    def __init__(self, *, tracker=DEFAULT, predictor=DEFAULT, latency=0.0, num_hypotheses=2):
        self.builder = DiagramBuilder()
        arm = self.builder.AddSystem(TrajectorySource(JOINTS, output_derivative_order=1))
        self.state = arm.get_output_port()
        self.tracker = self.builder.AddSystem(StandIn(timing=tracker))
        self.predictor = self.builder.AddNamedSystem(
            "predictor",
            MffPredictor(
                plant=ARM, num_hypotheses=num_hypotheses, latency=latency, timing=predictor
            ),
        )

    def connect(self):
        """Connects the feedforward by the function."""
        ConnectFeedforward(
            self.builder,
            recognizer=self.tracker,
            predictor=self.predictor,
            estimated_state=self.state,
        )
        return self

    def connect_by_hand(self):
        """Connects the same without looking."""
        for sender, receiver, port in (
            (self.tracker, self.predictor, "population"),
            (self.tracker, self.predictor, "frame_time"),
            (self.predictor, self.tracker, "predicted_population"),
        ):
            self.builder.Connect(sender.GetOutputPort(port), receiver.GetInputPort(port))
        self.builder.Connect(self.state, self.predictor.GetInputPort("estimated_state"))
        return self

    def simulator(self):
        return Simulator(self.builder.Build())


def test_it_connects_all_that_the_loop_needs():
    connected, by_hand = Loop().connect(), Loop().connect_by_hand()
    for loop in (connected, by_hand):
        loop.simulator().AdvanceTo(0.2)
    assert len(connected.tracker.taken) == 7
    for (time, predicted), (_, expected) in zip(
        connected.tracker.taken, by_hand.tracker.taken, strict=True
    ):
        np.testing.assert_array_equal(predicted, expected)
        still = np.tile([0.0, 0.155, 0.8, 0.0, 0.0, 0.0], 2)
        assert np.array_equal(predicted, still) == (time == 0.0)


def test_other_rates_are_told_when_building():
    loop = Loop(tracker=Timing(vision_period=0.030), predictor=Timing())
    message = (
        "recognizer's timing is Timing(control_period=0.001, vision_period=0.03), but the "
        "predictor's Timing(control_period=0.001, vision_period=0.033); give both the same"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        loop.connect()


def test_other_numbers_of_hypotheses_are_told_when_building():
    message = "recognizer's number of hypotheses is 2, but the predictor's 3; give both the same"
    with pytest.raises(ValueError, match=message):
        Loop(num_hypotheses=3).connect()


@pytest.mark.parametrize("frames", [0.0, 0.03, 0.5, 1.0, 1.2, 2.97, 7.0])
@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_with_one_timing_the_frame_times_agree_at_and_between_all_frames(timing, frames):
    latency = timing.TimeOfTick(round(frames * timing.vision_period / timing.control_period))
    loop = Loop(tracker=timing, predictor=timing, latency=latency).connect()
    simulator = loop.simulator()
    context = loop.predictor.GetMyContextFromRoot(simulator.get_context())
    predicted = loop.predictor.GetOutputPort("predicted_population")
    for tick in range(timing.TickOfFrame(11)):
        simulator.AdvanceTo(timing.TimeOfTick(tick))  # before the events at that time
        predicted.Eval(context)
        if tick % 5 == 0:  # after them, and in the middle between two ticks
            simulator.AdvancePendingEvents()
            predicted.Eval(context)
            simulator.AdvanceTo(timing.TimeOfTick(tick) + 0.4 * timing.control_period)
            predicted.Eval(context)
    assert len(loop.tracker.taken) == 11


@pytest.mark.parametrize("latency", [0.0, 0.010, 0.033, 0.050, 0.100])
@pytest.mark.parametrize(
    ("tracker", "predictor"),
    [
        (Timing(vision_period=0.030), Timing()),
        (Timing(), Timing(vision_period=0.030)),
        (Timing(vision_period=1 / 30), Timing()),
        (Timing(), Timing(vision_period=1 / 30)),
        (Timing(vision_period=0.066), Timing()),
        (Timing(), Timing(vision_period=0.066)),
        (Timing(), Timing(vision_period=0.034)),
    ],
    ids=str,
)
def test_other_rates_are_told_in_the_simulation(tracker, predictor, latency):
    loop = Loop(tracker=tracker, predictor=predictor, latency=latency).connect_by_hand()
    message = (
        rf"^predictor: at 0.\d+ s the tracker's last frame \('frame_time'\) was at 0.?\d* s, but "
        rf"this system's at 0.?\d* s, with a frame every {predictor.vision_period:.6g} s; "
        "give both the same timing$"
    )
    with pytest.raises(RuntimeError, match=message):
        loop.simulator().AdvanceTo(0.8)
    frames_before = (latency + 2 * predictor.vision_period) / tracker.vision_period
    assert len(loop.tracker.taken) <= frames_before + 3


def test_before_the_first_frame_there_is_nothing_to_compare():
    predictor = MffPredictor(plant=ARM, num_hypotheses=1)
    context = predictor.CreateDefaultContext()
    for name, value in (
        ("population", np.zeros(6)),
        ("estimated_state", np.zeros(14)),
        ("frame_time", [np.nan]),
    ):
        predictor.GetInputPort(name).FixValue(context, value)
    predictor.CalcForcedDiscreteVariableUpdate(context, context.get_mutable_discrete_state())
    predicted = predictor.GetOutputPort("predicted_population")
    np.testing.assert_allclose(predicted.Eval(context), np.zeros(6), atol=1e-15)
    predictor.GetInputPort("frame_time").FixValue(context, [0.5])
    with pytest.raises(RuntimeError, match="last frame .* was at 0.5 s, but this system's at 0 s"):
        predicted.Eval(context)
