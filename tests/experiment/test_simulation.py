"""A simulation's record: exact frames, the truth, what the recognizer saw, nothing disturbed."""

import dataclasses as dc
import gc

import numpy as np
import psutil
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import System

from mffdrake.experiment.scenario.scenario import Change, LoadScenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError
from mffdrake.systems.arms.pa10 import MakePa10Plant
from mffdrake.systems.timing import Timing

ARRAYS = {
    "time": (), "true_pose": (6,), "recognized_pose": (6,), "fitness": (),
    "desired_hand_pose": (6,), "actual_hand_pose": (6,),
    "joint_positions": (7,), "joint_velocities": (7,),
}  # fmt: skip
STAGES = ["render", "recognition", "prediction", "total"]


def load(text=""):
    """A fast swing seen in small images for less than a second."""
    values = {"camera.width": 160, "camera.height": 120, "hand_path.omega": 0.314}
    if "duration" not in text:
        values["duration"] = 0.7
    return Change(LoadScenario(text=text), values)


def assert_bitwise_equal(first, second):
    for name in ARRAYS:
        a, b = getattr(first, name), getattr(second, name)
        assert a.dtype == b.dtype == np.float64
        assert a.tobytes() == b.tobytes(), name
    assert first.scenario == second.scenario


@pytest.fixture(scope="module", params=["ga", "mff"])
def scenario(request):
    return load(f"method: {request.param}")


@pytest.fixture(scope="module")
def diagram(scenario):
    return MakeHandEyeDiagram(scenario)


@pytest.fixture(scope="module")
def frames(scenario):
    """What ``on_frame`` was told."""
    return []


@pytest.fixture(scope="module")
def result(scenario, diagram, frames):
    return Simulate(scenario, diagram=diagram, on_frame=lambda *times: frames.append(times))


# Frames.


def test_frames_are_exactly_33_ms_apart(result):
    ticks = 33 * np.arange(22)  # 0.693 s is the last one before 0.7 s.
    np.testing.assert_array_equal(result.time, ticks * 0.001)


def test_every_array_has_a_row_for_each_frame(result):
    for name, shape in ARRAYS.items():
        values = getattr(result, name)
        assert values.shape == (22, *shape)
        assert np.all(np.isfinite(values))


def test_on_frame_is_called_for_each_frame(result, frames):
    simulated, wall = np.array(frames).T
    assert len(frames) == len(result.time)
    np.testing.assert_array_equal(simulated[:-1], result.time[1:])  # At the end of each frame.
    assert simulated[-1] == 0.7
    assert np.all(np.diff(wall, prepend=0.0) > 0.0)
    assert wall[-1] <= result.wall_s


@pytest.mark.parametrize(
    ("duration", "count"),
    [(0.001, 1), (0.02, 1), (0.033, 1), (0.034, 2), (0.05, 2), (0.066, 2), (0.0505, 2), (0.1, 4)],
)
def test_a_duration_need_not_be_a_multiple_of_the_frame(duration, count):
    ends = []
    scenario = load(f"duration: {duration}")
    result = Simulate(scenario, on_frame=lambda simulated, _: ends.append(simulated))
    np.testing.assert_array_equal(result.time, 33 * np.arange(count) * 0.001)
    assert len(ends) == count
    assert ends[-1] == duration
    assert result.recognized_pose.shape == (count, 6)


def test_other_periods_make_other_frames():
    scenario = load(
        "{duration: 0.2, timing: {control_period: 0.002, vision_period: 0.05}, "
        "predictor: {mode: velocity}}"
    )
    result = Simulate(scenario)
    timing = Timing(control_period=0.002, vision_period=0.05)
    np.testing.assert_array_equal(result.time, [timing.TimeOfFrame(k) for k in range(4)])


# The truth.


def test_the_true_pose_is_drakes_own_kinematics_at_the_frames_joints(scenario, result):
    arm = MakePa10Plant()
    context = arm.CreateDefaultContext()
    X_WM = scenario.target.X_WM.GetDeterministicValue()
    for q, expected in zip(result.joint_positions, result.true_pose, strict=True):
        arm.SetPositions(context, q)
        X_CM = arm.GetFrameByName("camera_right").CalcPoseInWorld(context).InvertAndCompose(X_WM)
        pose = pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())
        np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_the_hand_poses_are_those_of_the_joints_and_of_the_path(scenario, result):
    arm = MakePa10Plant()
    context = arm.CreateDefaultContext()
    path = scenario.hand_path.Make()
    X_E0W = path.CalcHandPose(0.0).inverse()

    def vector(X_WE):
        X_E0E = X_E0W @ X_WE
        return pose_from_transform(X_E0E.rotation().matrix(), X_E0E.translation())

    for k, time in enumerate(result.time):
        arm.SetPositions(context, result.joint_positions[k])
        X_WE = arm.GetFrameByName("hand").CalcPoseInWorld(context)
        np.testing.assert_allclose(result.actual_hand_pose[k], vector(X_WE), atol=1e-12)
        desired = vector(path.CalcHandPose(time))
        np.testing.assert_allclose(result.desired_hand_pose[k], desired, atol=1e-12)


def test_the_arm_starts_at_rest_in_the_first_pose_and_then_swings(result):
    np.testing.assert_array_equal(result.joint_velocities[0], np.zeros(7))
    np.testing.assert_allclose(result.actual_hand_pose[0], np.zeros(6), atol=1e-8)
    np.testing.assert_allclose(result.desired_hand_pose[0], np.zeros(6), atol=1e-12)
    np.testing.assert_allclose(result.true_pose[0], [0, 0.155, 0.8, 0, 0, 0], atol=1e-7)
    offset = np.linalg.norm(result.actual_hand_pose - result.desired_hand_pose, axis=1)
    assert 0.005 < offset.max() < 0.05  # The path starts at full speed, the arm does not.
    assert np.linalg.norm(result.true_pose[-1] - result.true_pose[0]) > 0.02


# What the recognizer saw. A plain simulation of the same diagram has the same numbers to the last
# bit: recording disturbs nothing.


def test_the_record_is_what_a_plain_simulation_shows(diagram, result):
    simulator = Simulator(diagram)
    context = simulator.get_context()
    timing = Timing()
    for frame in range(len(result.time)):
        if frame > 0:  # Advancing to 0 would handle the events at 0, which are still to come.
            simulator.AdvanceTo(timing.TimeOfFrame(frame))
        state = diagram.GetOutputPort("state").Eval(context)
        assert state[:7].tobytes() == result.joint_positions[frame].tobytes()
        assert state[7:].tobytes() == result.joint_velocities[frame].tobytes()
        simulator.AdvanceTo(timing.TimeOfTick(33 * frame + 1))
        pose = diagram.GetOutputPort("recognizer.pose").Eval(context)
        fitness = diagram.GetOutputPort("recognizer.fitness").Eval(context)
        assert pose.tobytes() == result.recognized_pose[frame].tobytes()
        assert fitness.tobytes() == result.fitness[frame].tobytes()


def test_a_simulation_in_one_go_ends_the_same(scenario, diagram, result):
    simulator = Simulator(diagram)
    simulator.AdvanceTo(scenario.duration)
    context = simulator.get_context()
    assert context.get_time() == scenario.duration
    pose = diagram.GetOutputPort("recognizer.pose").Eval(context)
    fitness = diagram.GetOutputPort("recognizer.fitness").Eval(context)
    assert pose.tobytes() == result.recognized_pose[-1].tobytes()
    assert fitness[0] == result.fitness[-1]


def test_recording_leaves_the_recognizers_whole_state_as_in_a_plain_simulation(
    scenario, diagram, monkeypatch
):
    """The population and its fitness too: read from the context in which `Simulate` ran."""
    contexts = []

    class Watched(Simulator):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            contexts.append(self.get_context())

    monkeypatch.setattr("mffdrake.experiment.simulation.simulation.Simulator", Watched)
    Simulate(scenario, diagram=diagram)
    plain = Simulator(diagram)
    plain.AdvanceTo(scenario.duration)
    (recorded,) = contexts
    assert recorded.get_time() == plain.get_context().get_time()
    for part in ("recognizer", "plant", "pd_controller"):
        system = diagram.GetSubsystemByName(part)
        states = [
            np.concatenate(
                [
                    system.GetMyContextFromRoot(context).get_discrete_state(k).value()
                    for k in range(system.GetMyContextFromRoot(context).num_discrete_state_groups())
                ]
            )
            for context in (recorded, plain.get_context())
        ]
        assert states[0].tobytes() == states[1].tobytes(), part


def test_the_recognized_pose_comes_near_the_true_one(result):
    error = np.linalg.norm((result.recognized_pose - result.true_pose)[:, :3], axis=1)
    assert np.all((result.fitness >= 0.0) & (result.fitness <= 1.0))
    assert error[-1] < 0.2


# The same seed, the same numbers.


def test_the_same_seed_gives_the_same_bits_and_another_one_others(scenario, result):
    assert_bitwise_equal(Simulate(scenario), result)  # Also from a diagram of its own.
    other = Simulate(dc.replace(scenario, seed=1))
    np.testing.assert_array_equal(other.true_pose, result.true_pose)  # The arm knows no chance.
    assert np.any(other.recognized_pose[0] != result.recognized_pose[0])
    assert np.any(other.fitness != result.fitness)


# Times.


def test_the_stages_take_time_and_their_sum_is_less_than_the_total(result):
    assert list(result.stages_ms) == STAGES
    assert all(value > 0.0 for value in result.stages_ms.values())
    total = result.stages_ms["total"]
    assert sum(result.stages_ms.values()) - total < total
    assert 1e-3 * total * len(result.time) <= result.wall_s


# Files.


def test_a_saved_record_is_loaded_to_the_last_bit(tmp_path, result):
    result.Save(tmp_path / "result.npz")
    again = SimulationResult.Load(tmp_path / "result.npz")
    assert_bitwise_equal(again, result)
    assert again.stages_ms == result.stages_ms
    assert again.wall_s == result.wall_s
    assert {type(getattr(again, f.name)) for f in dc.fields(again)} == {
        type(getattr(result, f.name)) for f in dc.fields(result)
    }
    assert [path.name for path in tmp_path.iterdir()] == ["result.npz"]


def test_a_saved_record_is_plain_arrays_with_the_documented_names(tmp_path, result):
    result.Save(str(tmp_path / "result.npz"))
    with np.load(tmp_path / "result.npz", allow_pickle=False) as data:
        assert set(ARRAYS) <= set(data.files)
        np.testing.assert_array_equal(data["true_pose"], result.true_pose)
        assert LoadScenario(text=str(data["scenario"])).Dump() == result.scenario


def test_a_record_can_be_saved_under_any_name(tmp_path, result):
    result.Save(tmp_path / "record")
    assert [path.name for path in tmp_path.iterdir()] == ["record"]
    assert_bitwise_equal(SimulationResult.Load(tmp_path / "record"), result)


def test_a_record_that_cannot_be_saved_or_loaded_is_an_os_error(tmp_path, result):
    with pytest.raises(OSError):
        result.Save(tmp_path / "missing" / "result.npz")
    with pytest.raises(OSError):
        SimulationResult.Load(tmp_path / "missing.npz")


# Errors come from the diagram's building.


def test_bad_scenarios_are_errors_before_anything_runs():
    frames = []
    for scenario, error in (
        (Change(load(), {"target.model": "missing.sdf"}), ScenarioError),
        (load("hand_path: {X_WE0: {translation: [3, 0, 0]}}"), UnreachablePathError),
    ):
        with pytest.raises(error):
            Simulate(scenario, on_frame=lambda *times: frames.append(times))
    assert frames == []


def test_the_target_in_the_record_is_the_scenarios(tmp_path):
    """Not the default one: the true pose follows X_WM."""
    scenario = load("{duration: 0.01, target: {X_WM: {translation: [1.75, 0.02, 0.44]}}}")
    result = Simulate(scenario)
    X_WC = scenario.hand_path.Make().CalcHandPose(0.0) @ RigidTransform(scenario.camera.p_EC)
    p_CM = X_WC.inverse() @ np.array([1.75, 0.02, 0.44])
    np.testing.assert_allclose(result.true_pose[0, :3], p_CM, atol=1e-7)


# Memory


def living_systems():
    """Number of systems and diagrams that there are in this process."""
    # Not isinstance: it asks weak proxies for the class of what they stood for.
    return sum(issubclass(type(thing), System) for thing in gc.get_objects())


@pytest.mark.parametrize("method", ["ga", "mff"])
def test_a_simulation_frees_its_diagram(method):
    scenario = load(f"{{duration: 0.1, method: {method}}}")
    Simulate(scenario)
    gc.collect()
    before = living_systems()
    gc.disable()  # It does not wait for the collector to come by.
    try:
        for _ in range(3):
            Simulate(scenario)
            assert living_systems() <= before
    finally:
        gc.enable()


@pytest.mark.parametrize("method", ["ga", "mff"])
def test_ten_simulations_take_no_more_memory_than_one(method):
    """A context that is not freed is not seen by Python: it takes megabytes of C++."""
    process, short = psutil.Process(), load(f"{{method: {method}, duration: 0.1}}")
    for _ in range(3):
        Simulate(short)
    before = process.memory_info().rss
    for _ in range(10):
        Simulate(short)
    assert process.memory_info().rss - before < 10e6  # one context of them would take 30 MB


def test_a_given_diagram_can_be_used_again(scenario):
    diagram = MakeHandEyeDiagram(scenario)
    first, again = Simulate(scenario, diagram=diagram), Simulate(scenario, diagram=diagram)
    np.testing.assert_array_equal(first.recognized_pose, again.recognized_pose)


# Late cameras, askew cameras, noisy encoders


def test_late_cameras_show_what_was_some_frames_ago():
    now = Simulate(load("{duration: 0.7, method: ga, renderer: flat}"))
    late = Simulate(load("{duration: 0.7, method: ga, renderer: flat, camera: {latency: 0.066}}"))
    np.testing.assert_array_equal(late.joint_positions, now.joint_positions)
    np.testing.assert_allclose(late.true_pose[3:], now.true_pose[1:-2], atol=1e-12)
    np.testing.assert_allclose(late.true_pose[:2], now.true_pose[[0, 0]], atol=1e-12)
    # The same images as before, with the same random numbers a frame, from the first frame on.
    scenario = load("{renderer: flat, camera: {latency: 0.066}}")
    diagram = MakeHandEyeDiagram(scenario)
    simulator = Simulator(diagram)
    images = []
    for frame in range(20):
        simulator.AdvanceTo(Timing().TimeOfFrame(frame))
        port = diagram.GetOutputPort("stereo_camera.color_image_right")
        state = diagram.GetOutputPort("state").Eval(simulator.get_context())
        images.append((port.Eval(simulator.get_context()).data.copy(), state))
    again = MakeHandEyeDiagram(load("{renderer: flat}"))
    plant = again.GetSubsystemByName("plant")
    context = again.CreateDefaultContext()
    for frame in (10, 19):
        positions = images[frame - 2][1][:7]
        arm = plant.GetModelInstanceByName("pa10")
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, positions)
        now = again.GetOutputPort("stereo_camera.color_image_right").Eval(context).data
        np.testing.assert_array_equal(images[frame][0], now)
        assert np.any(images[frame][0] != images[0][0])


@pytest.mark.parametrize(("latency", "compensated"), [("null", True), ("0.0", False)])
def test_a_known_latency_does_no_harm_and_an_unknown_one_does(latency, compensated):
    text = """
        duration: 3.0
        renderer: flat
        camera: {latency: 0.099}
        recognizer: {start: near_target}
        predictor: {latency: %s}
    """
    result = Simulate(load(text % latency))
    settled = result.fitness[45:].mean()
    assert settled > 0.97 if compensated else settled < 0.9


@pytest.mark.parametrize(
    "flaw", ["encoders: {noise_deg: 0.3}", "predictor: {hand_eye_error_deg: [0, 20, 0]}"]
)
def test_flaws_of_the_feedforward_cost_accuracy(flaw):
    common = "duration: 2.0\nrenderer: flat\nrecognizer: {start: near_target}\n"
    good, bad = Simulate(load(common)), Simulate(load(common + flaw))
    errors = [
        np.linalg.norm(r.recognized_pose[30:, :3] - r.true_pose[30:, :3], axis=1).mean()
        for r in (good, bad)
    ]
    assert errors[1] > 1.5 * errors[0]
