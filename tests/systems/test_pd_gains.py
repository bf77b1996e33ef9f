"""Gains have names for the PA-10, and a natural frequency for any arm."""

import re

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from mffdrake.recognition.parameters import ParameterError, read_parameters
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, NUM_JOINTS, AddPa10, MakePa10Plant
from mffdrake.systems.control.pd_controller import PdController
from mffdrake.systems.control.pd_gains import PD_GAINS, NaturalFrequency, PdGains
from mffdrake.systems.timing import Timing


@pytest.fixture(scope="module")
def plant():
    return MakePa10Plant()


# The presets.


def test_presets_have_names():
    assert list(PD_GAINS) == ["lightly_damped", "well_damped"]
    assert PdGains.FromPreset("lightly_damped") == PdGains.LightlyDamped()
    assert PdGains.FromPreset("well_damped") == PdGains.WellDamped()
    for gains in PD_GAINS.values():
        assert len(gains.kp) == len(gains.kd) == NUM_JOINTS


def test_an_unknown_preset_is_answered_with_the_known_ones():
    message = "unknown PD gains 'soft'; known presets: lightly_damped, well_damped"
    with pytest.raises(ValueError, match=f"^{message}$"):
        PdGains.FromPreset("soft")


# Any arm's.


def test_gains_are_those_of_the_mass_matrix_at_a_posture(plant):
    q = NOMINAL_POSITIONS + 0.1
    gains = PdGains.FromNaturalFrequency(plant, positions=q, frequency_hz=2.0, damping_ratio=0.3)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    M = np.diag(plant.CalcMassMatrix(context))
    w = 4.0 * np.pi
    strong = 0.01 * M.max() < M
    np.testing.assert_allclose(np.array(gains.kp)[strong], w**2 * M[strong], rtol=1e-14)
    np.testing.assert_allclose(np.array(gains.kd)[strong], 0.6 * w * M[strong], rtol=1e-14)
    # The wrist's are made for 1 % of the largest inertia.
    np.testing.assert_allclose(np.array(gains.kp)[~strong], w**2 * 0.01 * M.max(), rtol=1e-14)
    assert list(strong) == [True] * 4 + [False] * 3


def test_the_rotors_inertias_count():
    rotors = MakePa10Plant()
    without = MultibodyPlant(0.0)
    AddPa10(without)
    for i in without.GetJointActuatorIndices():
        without.get_mutable_joint_actuator(i).set_default_rotor_inertia(0.0)
    without.Finalize()
    values = {"positions": NOMINAL_POSITIONS, "frequency_hz": 1.0, "damping_ratio": 1.0}
    with_rotors = np.array(PdGains.FromNaturalFrequency(rotors, **values).kp)
    bare = np.array(PdGains.FromNaturalFrequency(without, **values).kp)
    w2 = (2.0 * np.pi) ** 2
    np.testing.assert_allclose((with_rotors - bare)[:4] / w2, [0.75, 0.75, 0.2125, 0.2125])


def test_they_come_near_the_presets_which_are_rounded(plant):
    for frequency_hz, damping_ratio, name in (
        (1.0, 0.018, "lightly_damped"),
        (3.0, 1.0, "well_damped"),
    ):
        gains = NaturalFrequency(frequency_hz=frequency_hz, damping_ratio=damping_ratio).MakeGains(
            plant, positions=NOMINAL_POSITIONS
        )
        preset = PD_GAINS[name]
        np.testing.assert_allclose(gains.kp[:6], preset.kp[:6], rtol=0.2)
        np.testing.assert_allclose(gains.kp[:4], preset.kp[:4], rtol=0.01)
        np.testing.assert_allclose(gains.kd[:4], preset.kd[:4], rtol=0.01)


def test_the_arm_can_be_one_of_several_models(plant):
    full = MultibodyPlant(0.0)
    body = full.AddRigidBody(
        "wheel", full.AddModelInstance("wheel"), SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    )
    full.AddJoint(RevoluteJoint("spin", full.world_frame(), body.body_frame(), [0, 0, 1]))
    arm = AddPa10(full)
    full.Finalize()
    values = {"positions": NOMINAL_POSITIONS, "frequency_hz": 1.0, "damping_ratio": 1.0}
    gains = PdGains.FromNaturalFrequency(full, model_instance=arm, **values)
    expected = PdGains.FromNaturalFrequency(plant, **values)
    np.testing.assert_allclose(gains.kp, expected.kp, rtol=1e-12)


def test_positions_that_do_not_fit_the_arm_are_refused_in_one_line(plant):
    message = (
        "PdGains: positions must have shape (7,), one number for each of S1, S2, S3, E1, E2, W1, "
        "W2, not (6,)"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        NaturalFrequency().MakeGains(plant, positions=np.zeros(6))


def test_a_scenario_can_name_a_frequency():
    read = read_parameters(NaturalFrequency, {"frequency_hz": 3, "damping_ratio": 0.5})
    assert read == NaturalFrequency(frequency_hz=3.0, damping_ratio=0.5)
    with pytest.raises(ParameterError, match="^frequency_hz must be positive, not 0$"):
        read_parameters(NaturalFrequency, {"frequency_hz": 0})


# The hold takes damping.


def swing(gains: PdGains, *, inertia: float, start: float, times: np.ndarray) -> np.ndarray:
    """Amplitudes of one free joint under control, from rest at an angle."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=0.001, use_sampled_output_ports=False), builder
    )
    body = plant.AddRigidBody("bar", _Bar(inertia))
    joint = plant.AddJoint(
        RevoluteJoint("joint", plant.world_frame(), body.body_frame(), [0, 0, 1])
    )
    plant.AddJointActuator("motor", joint)
    plant.Finalize()
    controller = builder.AddSystem(PdController(kp=gains.kp, kd=gains.kd))
    desired = builder.AddSystem(ConstantVectorSource(np.zeros(2)))
    builder.Connect(desired.get_output_port(), controller.GetInputPort("desired_state"))
    state = plant.get_state_output_port()
    builder.Connect(state, controller.GetInputPort("estimated_state"))
    builder.Connect(controller.get_output_port(), plant.get_actuation_input_port())
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    joint.set_angle(context, start)
    w = np.sqrt(gains.kp[0] / inertia)
    amplitudes = []
    for t in times:
        simulator.AdvanceTo(t)
        amplitudes.append(np.hypot(joint.get_angle(context), joint.get_angular_rate(context) / w))
    return np.array(amplitudes)


def _Bar(inertia: float) -> SpatialInertia:
    return SpatialInertia(1.0, np.zeros(3), UnitInertia(0.6 * inertia, 0.6 * inertia, inertia))


@pytest.mark.parametrize("damping_ratio", [0.0, 0.018])
def test_the_hold_of_1_ms_takes_kp_times_1_ms_off_the_damping(damping_ratio):
    """So the swing grows without damping, and decays by ``(kd - kp 1 ms) / (2 M)`` with it."""
    inertia, w = 0.5, 2.0 * np.pi
    kp, kd = inertia * w**2, 2.0 * damping_ratio * w * inertia
    times = np.arange(0.0, 21.0, 5.0)  # Whole swings.
    amplitudes = swing(PdGains(kp=(kp,), kd=(kd,)), inertia=inertia, start=0.1, times=times)
    rate = 0.5 * (kd - 0.001 * kp) / inertia
    assert (rate > 0.0) == (damping_ratio > np.pi * 0.001)
    np.testing.assert_allclose(amplitudes, 0.1 * np.exp(-rate * times), rtol=0.02)


def test_less_damping_than_the_hold_takes_is_refused(plant):
    message = (
        "NaturalFrequency: damping_ratio must be above 0.00942, not 0.009: at 3 Hz the "
        "controller's hold of 1 ms takes that much off it. Raise it, or reduce frequency_hz."
    )
    frequency = NaturalFrequency(frequency_hz=3.0, damping_ratio=0.009)
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        frequency.MakeGains(plant, positions=NOMINAL_POSITIONS)
    faster = Timing(control_period=0.0005, vision_period=0.033)
    gains = frequency.MakeGains(plant, positions=NOMINAL_POSITIONS, timing=faster)
    assert np.all(np.array(gains.kd) > 0.0005 * np.array(gains.kp))
