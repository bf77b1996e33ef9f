"""The studies: what they vary, and that every variant can be run."""

import numpy as np
import pytest

from mffdrake.experiment.paper.studies import FEW_SEEDS, PAPER_OMEGAS, PLAIN_GA, MakeStudies
from mffdrake.experiment.paper.study import PlanRuns, Study, Variant
from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import CheckScenario

SMALL = "{duration: 0.2, camera: {width: 64, height: 48}}"


def plan(**options):
    return PlanRuns(MakeStudies(**options), Scenario())


@pytest.fixture(scope="module")
def full():
    return plan(seeds=1, vtk_seeds=1)


def of(runs, name):
    """A study's scenarios by label."""
    return {run.labels["label"]: run.scenario for run in runs if run.labels["study"] == name}


# Every variant.


def test_every_variant_is_a_scenario_that_the_arm_can_follow_to_its_end(full):
    paths = {}
    for run in full:
        scenario = run.scenario
        assert scenario.duration == 40.0
        paths[scenario.hand_path.omega, str(scenario.hand_path.X_WE0)] = scenario
    assert len(paths) == 3 + 3 + 2  # The paper's speeds, the places of a fixed camera, faster.
    for scenario in paths.values():
        CheckScenario(scenario)


def test_names_and_labels_are_unique():
    studies = MakeStudies()
    assert len({study.name for study in studies}) == len(studies)
    for study in studies:
        labels = [variant.label for variant in study.variants]
        assert len(set(labels)) == len(labels), study.name
        points = [(variant.curve, variant.value) for variant in study.variants]
        assert len(set(points)) == len(points), study.name


def test_variants_of_a_study_differ_in_more_than_their_label(full):
    # No error is no error about any axis, and the images' age of 0 is known either way.
    for name in {run.labels["study"] for run in full} - {"hand_eye", "latency"}:
        scenarios = [run.scenario.fingerprint for run in full if run.labels["study"] == name]
        assert len(set(scenarios)) == len(scenarios), name


# The paper's table.


@pytest.mark.parametrize(
    ("name", "renderer", "start"),
    [
        ("random", "flat", "random"), ("near", "flat", "near_target"),
        ("vtk", "vtk", "random"), ("vtk_near", "vtk", "near_target"),
    ],
)  # fmt: skip
def test_the_tables_have_both_methods_at_the_papers_speeds(full, name, renderer, start):
    scenarios = of(full, name).values()
    assert [(s.method, s.hand_path.omega) for s in scenarios] == [
        (method, omega) for method in ("ga", "mff") for omega in PAPER_OMEGAS
    ]
    assert {s.renderer for s in scenarios} == {renderer}
    assert {s.recognizer.start for s in scenarios} == {start}


def test_all_but_the_vtk_studies_have_flat_images(full):
    for run in full:
        renderer = "vtk" if run.labels["study"].startswith("vtk") else "flat"
        assert run.scenario.renderer == renderer


def test_seeds_go_on_from_the_bases_and_studies_beyond_the_table_have_fewer():
    runs = PlanRuns(MakeStudies(8, vtk_seeds=2), Scenario(seed=3))
    seeds = {}
    for run in runs:
        seeds.setdefault(run.labels["study"], set()).add(run.scenario.seed)
    assert seeds["random"] == seeds["near"] == set(range(3, 11))
    assert seeds["vtk"] == {3, 4}
    assert seeds["plain"] == seeds["gain"] == set(range(3, 3 + FEW_SEEDS))


def test_no_vtk_seeds_is_no_vtk():
    assert not [run for run in plan(seeds=1, vtk_seeds=0) if run.scenario.renderer == "vtk"]


@pytest.mark.parametrize(("seeds", "vtk_seeds"), [(0, 1), (1, -1)])
def test_numbers_of_seeds_that_make_no_sense_are_errors(seeds, vtk_seeds):
    with pytest.raises(ScenarioError, match=f"not {seeds} and {vtk_seeds}"):
        MakeStudies(seeds, vtk_seeds=vtk_seeds)


# The single studies.


def test_a_fixed_camera_truly_rests_and_sees_the_target_in_the_same_place():
    studies = [study for study in MakeStudies(1, vtk_seeds=0) if study.name == "fixed"]
    places = []
    for run in PlanRuns(studies, LoadScenario(text=SMALL)):
        result = Simulate(run.scenario)
        assert np.ptp(result.joint_positions, axis=0).max() < 1e-9  # rad
        np.testing.assert_allclose(1e3 * result.true_pose[0, :3], [0, 155, 800], atol=1e-6)
        # The hand turns about the target, which turns the other way in its eyes.
        turned = -2.0 * np.degrees(np.arcsin(result.desired_hand_pose[0, 4]))
        assert turned == pytest.approx(0.0, abs=1e-9)  # E0 is where it rests.
        yaw = 2.0 * np.degrees(np.arcsin(result.true_pose[0, 4]))
        places.append(yaw)
        assert yaw == pytest.approx(run.labels["value"], abs=1e-6)
    np.testing.assert_allclose(places, [0.0, 15.0, -15.0], atol=1e-6)


def test_the_plain_ga_has_nothing_but_survivors_and_crossover_children():
    recognizer = LoadScenario(text=PLAIN_GA).recognizer
    assert recognizer.survivor_share == 0.5
    assert recognizer.local_share == recognizer.newcomer_share == 0.0
    assert recognizer.first_candidates == 1 and not recognizer.average_best
    assert (recognizer.start, recognizer.coding) == ("near_target", "binary")
    assert recognizer.generations_per_frame == 1


def test_latencies_are_whole_frames_known_or_ignored(full):
    for run in full:
        if run.labels["study"] == "latency":
            scenario = run.scenario
            frames = scenario.camera.latency / scenario.timing.vision_period
            assert frames == pytest.approx(run.labels["value"])
            assert (
                scenario.predictor.latency == {"known": None, "ignored": 0.0}[run.labels["curve"]]
            )


def test_what_the_sensitivities_vary(full):
    def values(name, read):
        return [read(scenario) for scenario in of(full, name).values()]

    assert values("gain", lambda s: s.predictor.gain) == [0, 0.25, 0.5, 0.75, 1, 1.25, 1.5]
    assert values("noise", lambda s: s.encoders.noise_deg) == [0, 0.005, 0.01, 0.02, 0.05, 0.1]
    errors = np.array(values("hand_eye", lambda s: s.predictor.hand_eye_error_deg))
    np.testing.assert_array_equal(errors, np.kron(np.eye(3), np.arange(6.0)[:, None]))
    assert values("generations", lambda s: s.recognizer.generations_per_frame) == 2 * [1, 3, 9]
    assert set(values("gray", lambda s: s.recognizer.coding)) == {"gray"}
    assert set(values("velocity", lambda s: (s.method, s.predictor.mode))) == {("mff", "velocity")}
    assert set(values("faster", lambda s: s.hand_path.omega)) == {0.628, 1.256}
    for name in ("latency", "gain", "hand_eye", "noise"):
        assert set(values(name, lambda s: (s.method, s.hand_path.omega))) == {("mff", 0.314)}


# What they are on top of.


def test_a_base_is_kept_where_a_study_says_nothing():
    base = LoadScenario(text="{duration: 3, recognizer: {population_size: 30}, renderer: vtk}")
    for run in PlanRuns(MakeStudies(short=True), base):
        scenario = run.scenario
        assert (scenario.duration, scenario.recognizer.population_size) == (3.0, 30)
        assert scenario.renderer == "flat"


def test_short_is_a_part_of_the_whole(full):
    short = {run.scenario.fingerprint for run in plan(short=True)}
    assert short < {run.scenario.fingerprint for run in full}
    assert len(short) <= 32


def test_a_wrong_variant_names_its_key():
    wrong = Variant(label="a", curve="a", value=0, changes=("camera: {widht: 3}",))
    study = Study(name="a", title="A", question="", axis="", variants=(wrong,), seeds=1)
    with pytest.raises(ScenarioError, match="widht"):
        PlanRuns([study], Scenario())
