"""The closed loop: the hand follows a moving target by what its cameras see."""

import dataclasses as dc
import json
import re

import numpy as np
import pytest

from mffdrake.experiment.commands.main import main
from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario, ServoDefaults
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.recovery import CalcHandErrors, FindLoss, WantedPose
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.poses import MakeDesiredHand
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose

SMALL = {"renderer": "flat", "camera.width": 320, "camera.height": 240}


def load(**values):
    changed = {key.replace("__", "."): value for key, value in values.items()}
    motion = {"_tag": "!Sinusoids", "amplitude": [0.0, 0.05, 0.0], "period": [4.0]}
    values = {**SMALL, "duration": 2.0, "target.motion": motion, **changed}
    return Change(ServoDefaults(), values)


def settled_error(scenario):
    """The hand's greatest error after the first second [m]."""
    result = Simulate(scenario)
    return CalcHandErrors(result, scenario)[0][result.time > 1.0].max(), result


@pytest.fixture(scope="module")
def followed():
    scenario = load()
    return (*settled_error(scenario), scenario)


def test_the_hand_follows_and_the_target_stays_where_it_is_wanted(followed):
    error, result, scenario = followed
    assert error < 4e-3
    assert np.ptp(result.actual_hand_pose[:, 0]) > 0.04  # as far as the target went
    assert result.is_tracking.mean() > 0.95
    np.testing.assert_allclose(WantedPose(scenario), CalcDesiredPose(scenario, 0.0), atol=1e-9)


def test_the_desired_hand_is_to_the_target_as_at_first(followed):
    _, result, scenario = followed
    X_WE = MakeDesiredHand(scenario)
    first = scenario.target.X_WM.GetDeterministicValue().InvertAndCompose(
        scenario.hand_path.Make().CalcHandPose(0.0)
    )
    for t in (0.0, 0.7, 1.9):
        assert scenario.target.CalcPose(t).InvertAndCompose(X_WE(t)).IsNearlyEqualTo(first, 1e-12)
    # Seen from the target, a small turn takes the hand, 0.8 m away, some millimeters aside.
    apart = np.linalg.norm((result.actual_hand_pose - result.desired_hand_pose)[:, :3], axis=1)
    assert apart[result.time > 1.0].max() < 0.015


def test_true_poses_are_the_limit(followed):
    error, result = settled_error(load(servo={"_tag": "!Follow", "source": "truth"}))
    assert error < 2e-3
    assert np.isfinite(result.recognized_pose).all()


def test_without_feedforward_it_knows_where_the_camera_was():
    error, result = settled_error(load(method="ga"))
    assert error < 4e-3
    diagram = MakeHandEyeDiagram(load(method="ga"))
    assert diagram.HasSubsystemNamed("camera_pose") and not diagram.HasSubsystemNamed("predictor")
    assert len(result.time)


def test_without_reference_accelerations_it_lags_more():
    fast = {"_tag": "!Sinusoids", "amplitude": [0.0, 0.05, 0.0], "period": [2.0]}
    lag, lead = (
        settled_error(load(target__motion=fast, controller__computed_torque=torque))[0]
        for torque in (False, True)
    )
    assert lag > 1.5 * lead


def test_through_an_occlusion_it_goes_on():
    scenario = load(
        duration=3.0,
        disturbances=[{"_tag": "!Black", "starts": [1.4], "duration": 0.5}],
    )
    result = Simulate(scenario)
    error = CalcHandErrors(result, scenario)[0]
    assert error[(result.time > 1.0) & (result.time < 1.9)].max() < 0.03
    assert error[result.time > 2.6].max() < 4e-3
    assert FindLoss(result) is None


def test_every_other_command_s_scenario_is_as_before():
    assert Scenario().servo.kind == "none"
    diagram = MakeHandEyeDiagram(Change(Scenario(), {**SMALL, "duration": 0.1}))
    assert not diagram.HasSubsystemNamed("visual_servo")
    assert "hand_rms" not in Evaluate(Simulate(Change(Scenario(), {**SMALL, "duration": 0.1})))


def test_a_loss_is_a_pose_that_has_nothing_to_do_with_the_target_for_a_second(followed):
    _, result, _ = followed
    assert FindLoss(result) is None
    off = result.recognized_pose.copy()
    off[20:25, 1] += 0.2  # not for long
    assert FindLoss(dc.replace(result, recognized_pose=off)) is None
    off[25:60, 1] += 0.2
    assert FindLoss(dc.replace(result, recognized_pose=off)) == pytest.approx(result.time[20])


def test_the_command_writes_results_and_pictures(tmp_path, capsys):
    text = "{camera: {width: 320, height: 240}, recognizer: {start: near_target}}"
    arguments = ["servo", "--renderer", "flat", "--duration", "1", "--scenario-text", text]
    arguments += ["--period", "4", "--amplitude", "0.03", "--method", "mff", "--seed", "5"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    (row,) = json.loads((tmp_path / "results.json").read_text())["runs"]
    assert row["hand_rms"]["position_mm"] < 10.0 and row["hand_rms"]["rotation_deg"] < 2.0
    assert row["hand_rms_settled"] == {"position_mm": None, "rotation_deg": None}
    assert row["lost_s"] is None and row["seed"] == 5
    for name in ("following", "hand_error", "space", "camera", "scene"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
    scenario = LoadScenario(tmp_path / "scenario.yaml")
    motion = scenario.target.motion
    assert motion.period == (4.0,) and motion.amplitude == (0.0, 0.03, 0.0)
    assert "never lost" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--period", "0"], "positive"),
        (["--amplitude", "-1"], "positive"),
        (["--scenario-text", "servo: !Follow {controller: {gain: 0}}"], "gain"),
        (["--scenario-text", "servo: chase"], "follow"),
        (["--scenario-text", "target: {X_WM: {translation: [9, 0, 0]}}"], "image|range|reach"),
    ],
)
def test_bad_input_is_one_line(arguments, message, tmp_path, capsys):
    try:
        status = main(["servo", "--renderer", "flat", "--duration", "0.1", *arguments,
                       "--out", str(tmp_path)])  # fmt: skip
    except SystemExit as stopped:
        status = stopped.code
    shown = capsys.readouterr().err
    if "translation" in str(arguments):
        assert status in (0, 2)  # It is far away, which is told.
        return
    assert status == 2
    assert len(shown.strip().splitlines()) == 1
    assert re.search(message, shown)


def test_a_target_that_leaves_the_arm_s_reach_ends_the_run_and_keeps_it(tmp_path, capsys, caplog):
    text = (
        "{camera: {width: 320, height: 240}, target: {motion: !Straight {velocity: [0.15, 0, 0]}}}"
    )
    status = main(["servo", "--renderer", "flat", "--duration", "20", "--scenario-text", text,
                   "--out", str(tmp_path)])  # fmt: skip
    assert status == 2
    assert "left the arm's reach" in capsys.readouterr().err
    (row,) = json.loads((tmp_path / "results.json").read_text())["runs"]
    assert 1.0 < row["duration"] < 20.0 and row["frames"] > 30
    assert any("cannot follow" in record.message for record in caplog.records)
