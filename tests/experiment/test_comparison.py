"""Many simulations: in a fixed order, and with the same numbers on any number of processes."""

import multiprocessing

import numpy as np
import pytest

from mffdrake.experiment.runs.compare import Compare, MakeVariants
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, ScenarioError
from mffdrake.systems.arms.inverse_kinematics import UnreachablePathError

ARRAYS = (
    "time", "true_pose", "recognized_pose", "fitness", "desired_hand_pose", "actual_hand_pose",
    "joint_positions", "joint_velocities",
)  # fmt: skip


def load(text=""):
    small = {"camera.width": 160, "camera.height": 120, "duration": 0.2}
    return Change(LoadScenario(text=text), small)


# Variants.


def test_variants_come_speed_by_speed_method_by_method_seed_by_seed():
    variants = MakeVariants(
        load("seed: 3"), methods=["mff", "ga"], omegas=[0.314, 0.105], num_seeds=2
    )
    assert [(v.hand_path.omega, v.method, v.seed) for v in variants] == [
        (0.314, "mff", 3), (0.314, "mff", 4), (0.314, "ga", 3), (0.314, "ga", 4),
        (0.105, "mff", 3), (0.105, "mff", 4), (0.105, "ga", 3), (0.105, "ga", 4),
    ]  # fmt: skip


def test_variants_differ_from_the_scenario_in_nothing_else():
    text = "{recognizer: {sampling: {margin: null}}, controller: {kp: [7, 6, 5, 4, 3, 2, 1]}}"
    scenario = load(text)
    before = scenario.Dump()
    variants = MakeVariants(scenario, methods=["ga"], omegas=[0.2], num_seeds=2)
    assert scenario.Dump() == before
    for variant in variants:
        assert variant.recognizer.sampling.margin is None
        assert variant.controller.kp == (7, 6, 5, 4, 3, 2, 1)
        same = {
            "hand_path.omega": scenario.hand_path.omega,
            "method": scenario.method,
            "seed": scenario.seed,
        }
        assert Change(variant, same).Dump() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"methods": ["ga", "best"]}, "method must be one of ga, mff, not 'best'"),
        ({"omegas": [0.1, -0.1]}, r"omega must be .*not -0.1"),
    ],
)
def test_a_wrong_variant_is_a_scenario_error(arguments, message):
    with pytest.raises(ScenarioError, match=message):
        MakeVariants(load(), **{"methods": ["ga"], "omegas": [0.1], "num_seeds": 1} | arguments)


# Runs.


@pytest.fixture(scope="module")
def scenarios():
    """The first takes longest, so that two processes finish in another order than they start."""
    variants = MakeVariants(load(), methods=["mff", "ga"], omegas=[0.314], num_seeds=2)
    variants[0] = Change(variants[0], {"duration": 1.5})
    # A value that must survive the way to a process.
    variants[1] = Change(variants[1], {"recognizer.sampling.margin": None})
    return variants


@pytest.fixture(scope="module")
def alone(scenarios):
    return Compare(scenarios)


def test_results_come_in_the_order_of_the_scenarios(scenarios, alone):
    assert [result.scenario for result in alone] == [scenario.Dump() for scenario in scenarios]
    assert [len(result.time) for result in alone] == [46, 7, 7, 7]


def test_two_processes_give_the_same_bits_in_the_same_order(scenarios, alone):
    told = []
    together = Compare(scenarios, workers=2, on_run=lambda run: told.append(run.frames))
    assert len(told) == len(scenarios)
    assert {id(result) for result in told} == {id(result) for result in together}
    assert multiprocessing.active_children() == []
    for ours, theirs in zip(alone, together, strict=True):
        assert ours.scenario == theirs.scenario
        for name in ARRAYS:
            assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), name


def test_runs_that_are_kept_are_not_repeated_and_give_the_same_bits(scenarios, alone, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        Compare(scenarios[1:], folder=tmp_path, on_run=interrupt)  # at the first run's end
    told = []
    results = Compare(scenarios[1:], folder=tmp_path, on_run=lambda run: told.append(run.was_kept))
    assert told == [True, False, False]
    for ours, theirs in zip(results, alone[1:], strict=True):
        assert ours.scenario == theirs.scenario
        for name in ARRAYS:
            assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), name
    told.clear()
    other = [Change(scenarios[1], {"seed": 99})]
    Compare(other, folder=tmp_path, on_run=lambda run: told.append(run.was_kept))
    assert told == [False]
    for file in (tmp_path / "records").iterdir():
        file.write_bytes(b"damaged")
    told.clear()
    Compare(other, folder=tmp_path, on_run=lambda run: told.append(run.was_kept))
    assert told == [False]


def interrupt(run):
    raise KeyboardInterrupt


def test_seeds_and_methods_make_a_difference(alone):
    fitness = [result.fitness[:7] for result in alone]
    for k in range(len(fitness)):
        for other in fitness[k + 1 :]:
            assert np.any(fitness[k] != other)


def test_one_process_tells_of_every_run_when_it_is_done(scenarios):
    told = []
    results = Compare(scenarios[2:], on_run=lambda run: told.append(run.frames))
    assert [id(result) for result in told] == [id(result) for result in results]


def test_no_scenarios_make_no_results():
    assert Compare([]) == []


# Errors.


def bad_scenarios():
    # Found out only where the diagram is built.
    missing = Change(load(), {"target.model": "missing.sdf"})
    far = load("hand_path: {X_WE0: {translation: [3, 0, 0.455]}}")
    return [(missing, ScenarioError, "target.model"), (far, UnreachablePathError, "t = 0.00 s")]


def test_an_error_in_a_run_is_that_error():
    for scenario, kind, text in bad_scenarios():
        with pytest.raises(kind, match=text):
            Compare([scenario])


def test_an_error_in_a_process_is_the_same_error_as_without(capfd):
    for scenario, kind, _ in bad_scenarios():
        with pytest.raises(kind) as expected:
            Compare([scenario])
        with pytest.raises(kind) as error:
            Compare([load(), scenario], workers=2)
        assert str(error.value) == str(expected.value)
    assert "Traceback" not in capfd.readouterr().err
