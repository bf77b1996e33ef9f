"""Vision falls on control ticks, to the bit, and which state a frame shows."""

import math
from fractions import Fraction

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.wiring.cameras import MakeRig
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose
from mffdrake.recognition import Generation, SolidModel
from mffdrake.recognition.parameters import ParameterError
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.timing import Timing

TIMINGS = [
    Timing(),
    Timing(control_period=0.002, vision_period=0.05),
    Timing(control_period=0.0005, vision_period=0.0335),
    Timing(control_period=0.001, vision_period=0.1),
    Timing(control_period=1 / 300, vision_period=1 / 30),
    Timing(control_period=0.004, vision_period=0.004),
]
BETWEEN = [
    Timing(vision_period=1 / 30),
    Timing(control_period=0.0005, vision_period=0.0073),
    Timing(control_period=0.002, vision_period=0.033),
]
"""No whole multiples."""


def periods(value):
    """A short name of a test's parameter."""
    if isinstance(value, Timing):
        return f"{value.control_period:.6g}/{value.vision_period:.6g}"
    return str(value)


class EventTimes(LeafSystem):
    """Notes the time of each of its periodic discrete updates at which it acts."""

    def __init__(self, period, acts=lambda time: True):
        super().__init__()
        self.times = []
        self._acts = acts
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context, _):
        if self._acts(context.get_time()):
            self.times.append(context.get_time())


def simulate(duration, *systems):
    """The simulator, after all events before the end of the duration [s]."""
    builder = DiagramBuilder()
    for system in systems:
        builder.AddSystem(system)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    return simulator


# Periods.


@pytest.mark.parametrize("name", ["control_period", "vision_period"])
@pytest.mark.parametrize(
    ("value", "rule"),
    [(0.0, "positive"), (-0.001, "positive"), (np.nan, "finite"), (np.inf, "finite")],
)
def test_periods_must_be_positive_and_finite(name, value, rule):
    with pytest.raises(ParameterError, match=f"Timing: {name} must be {rule}, not {value}"):
        Timing(**{name: value})


@pytest.mark.parametrize(("control", "vision"), [(0.033, 0.001), (0.001, 0.000999), (0.034, 0.033)])
def test_vision_must_not_be_faster_than_control(control, vision):
    message = rf"vision_period must be at least control_period \({control} s\), not {vision}; make"
    with pytest.raises(ParameterError, match=message):
        Timing(control_period=control, vision_period=vision)


# Frames.

PERIODS = {
    "30 Hz": Fraction(1, 30), "60 Hz": Fraction(1, 60), "24 Hz": Fraction(1, 24),
    "29.97 Hz": Fraction(1001, 30_000), "500 Hz": Fraction(1, 500), "300 Hz": Fraction(1, 300),
    "7.3 ms": Fraction("0.0073"), "33 ms": Fraction("0.033"), "33.5 ms": Fraction("0.0335"),
    "33.001 ms": Fraction("0.033001"), "2.25 ms": Fraction("0.00225"), "1 s": Fraction(1),
}  # fmt: skip
"""Exact vision periods [s] of which a control period may well be no whole share."""


@pytest.fixture(params=PERIODS)
def vision(request):
    return PERIODS[request.param]


@pytest.fixture(params=["0.001", "0.002", "0.0005"])
def control(request):
    return Fraction(request.param)


@pytest.fixture
def timing(control, vision):
    return Timing(control_period=float(control), vision_period=float(vision))


def nearest_tick(time, control):
    """By trying those around: the tick nearest to an exact time, the later one of two."""
    guess = int(time / control)
    return min(range(guess - 2, guess + 3), key=lambda n: (abs(n * control - time), -n))


MANY_FRAMES = [*range(500), *range(10**6, 10**6 + 500), *range(10**9, 10**9 + 500)]


def test_a_frame_falls_on_the_nearest_tick_however_late_it_gets(timing, control, vision):
    for frame in MANY_FRAMES:
        assert timing.TickOfFrame(frame) == nearest_tick(frame * vision, control)


@pytest.mark.parametrize(
    ("control", "vision"), [(0.001, 0.0335), (0.002, 0.033), (0.0005, 0.00725), (1 / 45, 1 / 30)]
)
def test_a_frame_in_the_middle_between_two_ticks_falls_on_the_later_one(control, vision):
    timing = Timing(control_period=control, vision_period=vision)
    whole = round(2 * vision / control)
    for frame in range(1, 100, 2):
        assert timing.TickOfFrame(frame) == (frame * whole + 1) // 2


def test_the_last_frame_at_any_tick(timing):
    ticks = [timing.TickOfFrame(frame) for frame in range(200)]
    for tick in range(min(ticks[-1], 3000)):
        (last,) = (k for k in range(199) if ticks[k] <= tick < ticks[k + 1])
        assert timing.FrameAtTick(tick) == timing.FrameAt(timing.TimeOfTick(tick)) == last
        assert timing.IsVisionTick(timing.TimeOfTick(tick)) == (tick == ticks[last])
    assert timing.FrameAtTick(-1) == -1


def test_delayed_frames_are_their_ticks_less_the_delay(timing):
    ticks = {timing.TickOfFrame(frame) for frame in range(200)}
    for delay in (1, 7, 40):
        for tick in range(max(ticks) // 4):
            expected = tick + delay in ticks
            assert timing.IsVisionTick(timing.TimeOfTick(tick), delay_ticks=delay) == expected


def test_the_time_of_a_frame_is_that_of_its_tick(timing):
    for frame in range(100):
        tick = timing.TickOfFrame(frame)
        assert timing.TimeOfFrame(frame) == timing.TimeOfTick(tick) == tick * timing.control_period


def test_frames_are_the_vision_period_apart_or_what_their_ticks_are(timing, control, vision):
    whole = (vision / control).denominator == 1
    for frame in range(1, 100):
        if whole:
            assert timing.TimeBefore(frame) == timing.vision_period
        apart = timing.TimeOfFrame(frame) - timing.TimeOfFrame(frame - 1)
        assert timing.TimeBefore(frame) == pytest.approx(apart, abs=1e-12)


def test_num_frames_counts_the_frames_before_the_end(timing):
    times = [timing.TimeOfFrame(frame) for frame in range(100)]
    for duration in np.linspace(0.0, times[-1], 300):
        expected = sum(time < duration - 1e-9 for time in times)
        assert timing.NumFrames(duration) == expected
    for frame in range(100):
        assert timing.NumFrames(times[frame]) == frame


def test_so_many_ticks_hold_no_more_frames_than_that(timing):
    frames = np.array([timing.TickOfFrame(frame) for frame in range(2000)])
    for ticks in (0, 1, 2, 10, 33, 34, 67, 100, 101):
        held = np.searchsorted(frames, frames[:1000] + ticks) - np.arange(1000)
        assert held.max() == timing.MaxFrames(ticks) == math.ceil(ticks / _ratio(timing))


def _ratio(timing):
    """Control ticks a frame."""
    quotient = timing.vision_period / timing.control_period
    return Fraction(quotient).limit_denominator(1000)


@pytest.mark.parametrize(
    ("timing", "ticks"), list(zip(TIMINGS, [33, 25, 67, 100, 10, 1], strict=True)), ids=periods
)
def test_where_the_periods_allow_frames_are_equally_many_ticks_apart(timing, ticks):
    for frame in MANY_FRAMES:
        assert timing.TickOfFrame(frame) == frame * ticks


# Counting.


@pytest.mark.parametrize("timing", TIMINGS, ids=periods)
def test_a_time_and_its_neighboring_floats_belong_to_the_same_tick(timing):
    for tick in (0, 1, 32, 33, 330, 999_999):
        time = timing.TimeOfTick(tick)
        assert timing.Tick(time) == tick
        assert timing.Tick(np.nextafter(time, -1.0)) == tick
        assert timing.Tick(np.nextafter(time, 1e9)) == tick


@pytest.mark.parametrize("timing", TIMINGS, ids=periods)
def test_vision_ticks_are_those_of_the_frames(timing):
    frames = {timing.TimeOfFrame(frame) for frame in range(10)}
    times = [timing.TimeOfTick(tick) for tick in range(timing.TickOfFrame(10))]
    assert {time for time in times if timing.IsVisionTick(time)} == frames


def test_delayed_vision_ticks_come_so_many_ticks_before_the_frames():
    timing = Timing()

    def first_ticks(delay):
        return [k for k in range(70) if timing.IsVisionTick(0.001 * k, delay_ticks=delay)]

    assert first_ticks(0) == [0, 33, 66]
    assert first_ticks(1) == [32, 65]
    assert first_ticks(10) == [23, 56]
    assert first_ticks(33) == [0, 33, 66]
    assert first_ticks(40) == [26, 59]


@pytest.mark.parametrize("timing", TIMINGS + BETWEEN, ids=periods)
@pytest.mark.parametrize("ticks", [1, 24, 25, 26, 33, 34, 66, 67, 100, 101, 1000])
def test_num_frames_is_the_number_of_frames_that_drake_runs(timing, ticks):
    duration = timing.TimeOfTick(ticks)
    camera = EventTimes(timing.control_period, timing.IsVisionTick)
    simulate(duration, camera)
    assert len(camera.times) == timing.NumFrames(duration)


def test_num_frames_of_a_duration_that_ends_between_two_ticks():
    for duration in (0.0003, 0.0326, 0.0331, 0.0335, 0.0661):
        camera = EventTimes(0.001, Timing().IsVisionTick)
        simulate(duration, camera)
        assert len(camera.times) == Timing().NumFrames(duration), duration


# Coincidence.


@pytest.mark.parametrize(
    ("timing", "frames"),
    [(TIMINGS[0], 10_000), *((t, 2000) for t in (*TIMINGS[1:], *BETWEEN))],
    ids=periods,
)
def test_every_frame_coincides_with_a_control_tick(timing, frames):
    control = EventTimes(timing.control_period)
    vision = EventTimes(timing.control_period, timing.IsVisionTick)
    ticks = timing.TickOfFrame(frames)
    simulator = simulate(timing.TimeOfTick(ticks), control, vision)
    assert simulator.get_num_steps_taken() == ticks  # no step between two ticks
    assert control.times == [timing.TimeOfTick(tick) for tick in range(ticks)]
    assert vision.times == [timing.TimeOfFrame(frame) for frame in range(frames)]


@pytest.mark.parametrize("timing", [*TIMINGS, Timing(vision_period=4.096)], ids=periods)
def test_periods_are_made_to_coincide_by_lengthening_them_a_little(timing):
    near = timing.Coinciding()
    assert near.coincides and near.Coinciding() == near
    for name in ("control_period", "vision_period"):
        exact, given = getattr(near, name), getattr(timing, name)
        assert given <= exact <= given * (1.0 + 1e-12)
    ticks = near.TickOfFrame(1)
    assert ticks == timing.TickOfFrame(1)
    for k in np.random.default_rng(0).integers(1, 10**9, 10_000).tolist():
        assert k * near.vision_period == (k * ticks) * near.control_period


@pytest.mark.parametrize("timing", [*BETWEEN, Timing(vision_period=4.097)], ids=periods)
def test_other_periods_stay_as_they_are(timing):
    assert timing.Coinciding() is timing and timing.event_period == timing.control_period


def test_periods_that_coincide_need_no_events_between_the_frames():
    timing = Timing().Coinciding()
    control, vision = EventTimes(timing.control_period), EventTimes(timing.event_period)
    simulator = simulate(timing.TimeOfFrame(3000), control, vision)
    assert simulator.get_num_steps_taken() == 99_000
    assert vision.times == [timing.TimeOfFrame(frame) for frame in range(3000)]
    assert set(vision.times) <= set(control.times)


def test_a_naive_pair_of_periods_drifts_apart():
    """Why `Timing` exists: Drake's events fall on offset + k * period, rounded."""
    control, vision = EventTimes(0.001), EventTimes(0.033)
    simulator = simulate(10.0, control, vision)
    late = [k for k in range(len(vision.times)) if k * 0.033 != 33 * k * 0.001]
    assert vision.times == [k * 0.033 for k in range(304)]
    assert [vision.times[k] for k in late] == sorted(set(vision.times) - set(control.times))
    assert all(k * 0.033 > 33 * k * 0.001 for k in late)
    assert len(late) == 49  # one frame in six, each in a step of its own
    assert simulator.get_num_steps_taken() == 10_000 + len(late)


# Which state a frame shows.

SCENARIO = """
duration: 0.2
method: {method}
camera: {{width: 320, height: 240}}
recognizer: {{population_size: 12, start: near_target}}
"""


def make_scenario(method="mff"):
    return LoadScenario(text=SCENARIO.format(method=method))


class Observer(LeafSystem):
    """A controller's view: what its input is at each of its own discrete updates."""

    def __init__(self, size, period=0.001):
        super().__init__()
        self.seen = {}
        port = self.DeclareVectorInputPort("value", size)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period,
            0.0,
            lambda context, _: self.seen.update({context.get_time(): port.Eval(context)}),
        )


@pytest.mark.parametrize(("sampled", "age"), [(False, 0.0), (True, 0.001)])
def test_with_sampled_ports_a_plants_state_would_be_a_tick_ahead(sampled, age):
    """Why the hand-eye diagram does without: an event at t would see the state of t + 1 ms."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.001, use_sampled_output_ports=sampled)
    plant, _ = AddMultibodyPlant(config, builder)
    stone = plant.AddRigidBody("stone", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.AddJoint(PrismaticJoint("fall", plant.world_frame(), stone.body_frame(), axis=[0, 0, -1]))
    plant.Finalize()
    observer = builder.AddSystem(Observer(2, period=0.01))
    builder.Connect(plant.get_state_output_port(), observer.get_input_port())
    Simulator(builder.Build()).AdvanceTo(0.1)
    gravity = plant.gravity_field().kDefaultStrength
    speeds = [state[1] for time, state in observer.seen.items() if time > 0.0]
    expected = [gravity * (time + age) for time in observer.seen if time > 0.0]
    np.testing.assert_allclose(speeds, expected, rtol=1e-9)


@pytest.mark.parametrize("method", ["ga", "mff"])
def test_a_frame_shows_the_plants_state_of_its_own_time(method):
    scenario = make_scenario(method)
    diagram = MakeHandEyeDiagram(scenario)
    solid = SolidModel.from_mesh_file(FindModelsPath() / "target_box.obj")
    tracker = scenario.recognizer.make_tracker(
        solid=solid,
        rig=MakeRig(scenario),
        seed=scenario.seed,
        start_pose=CalcDesiredPose(scenario, 0.0),
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant = diagram.GetSubsystemByName("plant")
    recognizer = diagram.GetSubsystemByName("recognizer")
    recognizer_context = recognizer.GetMyContextFromRoot(context)

    def images():
        ports = [diagram.GetOutputPort(f"stereo_camera.color_image_{s}") for s in ("right", "left")]
        return [port.Eval(context).data.copy() for port in ports]

    def population(port):
        return port.Eval(recognizer_context).reshape(-1, 6)

    simulator.AdvanceTo(0.033)  # The events at 0.033 s come with the next step.
    # From now on the base turns: the target moves by half a pixel from tick to tick.
    plant.SetVelocities(plant.GetMyMutableContextFromRoot(context), [1, 0, 0, 0, 0, 0, 0])
    on_time = images()
    last = Generation(
        population(
            recognizer.GetInputPort("predicted_population")
            if method == "mff"
            else recognizer.GetOutputPort("population")
        ),
        recognizer.GetOutputPort("population_fitness").Eval(recognizer_context),
    )
    simulator.AdvanceTo(0.034)
    a_tick_later = images()

    expected = tracker.track(last, on_time, frame=1)
    np.testing.assert_array_equal(
        population(recognizer.GetOutputPort("population")), expected.poses
    )
    np.testing.assert_array_equal(
        recognizer.GetOutputPort("population_fitness").Eval(recognizer_context), expected.fitness
    )
    assert np.any(tracker.track(last, a_tick_later, frame=1).fitness != expected.fitness)


def test_a_controller_sees_a_vision_result_one_tick_later():
    builder = DiagramBuilder()
    diagram = builder.AddSystem(MakeHandEyeDiagram(make_scenario()))
    population = diagram.GetOutputPort("recognizer.population")
    observer = builder.AddSystem(Observer(population.size()))
    builder.Connect(population, observer.get_input_port())
    Simulator(builder.Build()).AdvanceTo(0.1)
    seen = list(observer.seen.values())
    changes = [k for k in range(1, len(seen)) if np.any(seen[k] != seen[k - 1])]
    assert len(seen) == 100
    assert changes == [1, 34, 67]


@pytest.mark.parametrize("method", ["ga", "mff"])
def test_the_hand_eye_system_takes_its_frames_on_control_ticks(method):
    diagram = MakeHandEyeDiagram(make_scenario(method))
    simulator = Simulator(diagram)
    recognizer = diagram.GetSubsystemByName("recognizer")
    timing = recognizer.timing
    frame_time = recognizer.GetOutputPort("frame_time")
    context = recognizer.GetMyContextFromRoot(simulator.get_context())
    seen = []
    for tick in range(1, 101):
        simulator.AdvanceTo(timing.TimeOfTick(tick))
        (time,) = frame_time.Eval(context)
        if time not in seen:
            seen.append(time)
            assert tick == 33 * len(seen) - 32
    assert seen == [timing.TimeOfFrame(k) for k in range(4)]
    np.testing.assert_allclose(seen, [0.0, 0.033, 0.066, 0.099], rtol=1e-15)
    assert simulator.get_num_steps_taken() == 100
