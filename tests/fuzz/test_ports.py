"""Any numbers at the ports of Drake systems: numbers come out, or one line names the port; never
the end of the process."""

import functools

import numpy as np
from hypothesis import example
from hypothesis import strategies as st
from judging import ODD_NUMBERS, check_message, prop, vectors
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageRgba8U

import mffdrake as mff
from mffdrake.recognition import BLUE, GREEN, RED
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant

SANE = st.floats(-1.0, 1.0)
AT_REST = np.append(NOMINAL_POSITIONS, np.zeros(7))
WIDTH, HEIGHT = 64, 48


@st.composite
def states(draw):
    """The arm's state, with up to three odd numbers."""
    state = AT_REST.copy()
    for _ in range(draw(st.integers(0, 3))):
        state[draw(st.integers(0, 13))] = draw(st.one_of(ODD_NUMBERS, SANE))
    return state


def refused(function, *args):
    """What a function returns, and whether it refused to with one clear line."""
    try:
        return function(*args), False
    except RuntimeError as error:
        check_message(str(error))
        assert "input port '" in str(error), error
        return None, True


@functools.cache
def predictor(mode):
    return mff.MffPredictor(plant=MakePa10Plant(), num_hypotheses=2, mode=mode)


POPULATION = st.one_of(vectors(12), vectors(12, SANE))
VELOCITY = st.one_of(vectors(6), vectors(6, SANE))


@example("rigid", AT_REST * np.nan, AT_REST, np.zeros(12), np.zeros(6))
@prop(st.sampled_from(["rigid", "velocity"]), states(), states(), POPULATION, VELOCITY)
def test_a_predictor_gives_numbers_or_names_the_port(mode, last, present, population, velocity):
    system = predictor(mode)
    context = system.CreateDefaultContext()
    system.GetInputPort("population").FixValue(context, population)
    system.GetInputPort("target_velocity").FixValue(context, velocity)
    system.GetInputPort("estimated_state").FixValue(context, last)
    state = context.get_mutable_discrete_state()
    if refused(system.CalcForcedDiscreteVariableUpdate, context, state)[1]:
        assert not (np.abs(last) <= 1e100).all()
        return
    system.GetInputPort("estimated_state").FixValue(context, present)
    for name in ("predicted_population", "camera_displacement", "X_WC", "pose_rate"):
        value, _ = refused(system.GetOutputPort(name).Eval, context)
        if isinstance(value, RigidTransform):
            value = value.GetAsMatrix34()
        assert value is None or np.isfinite(value).all(), (name, value)


@prop(vectors(4), vectors(4), vectors(2), vectors(2))
def test_a_controller_keeps_its_limits(estimated, desired, feedforward, limit):
    limit = np.where(limit > 0.0, limit, 5.0)
    controller = mff.PdController(kp=[100.0, 50.0], kd=[10.0, 5.0], effort_limit=limit)
    context = controller.CreateDefaultContext()
    controller.GetInputPort("estimated_state").FixValue(context, estimated)
    controller.GetInputPort("desired_state").FixValue(context, desired)
    controller.GetInputPort("feedforward_torque").FixValue(context, feedforward)
    state = context.get_mutable_discrete_state()
    controller.CalcForcedDiscreteVariableUpdate(context, state)
    torque = controller.get_output_port().Eval(context)
    numbers = np.concatenate([estimated, desired, feedforward])
    if (np.abs(numbers) < 1e100).all():
        assert (np.abs(torque) <= limit).all()
    else:
        assert (np.isnan(torque) | (np.abs(torque) <= limit)).all()


@functools.cache
def tracker(refine):
    rig = mff.CameraRig.stereo(width=WIDTH, height=HEIGHT)
    box = mff.SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
    return mff.PoseTracker.of(rig, box, channel_order="rgb", refine=refine).algorithm


@functools.cache
def picture(width, height):
    image = ImageRgba8U(width, height)
    image.mutable_data[:] = 128
    image.mutable_data[16:32, 27:38] = (0, 0, 255, 255)
    return image


ROW = st.one_of(vectors(6), vectors(6, st.floats(-0.4, 0.4)))


@example(False, [np.full(6, np.nan)], None)
@prop(
    st.booleans(),
    st.lists(ROW, min_size=1, max_size=3),
    st.one_of(st.none(), vectors(3, st.floats(allow_nan=False, allow_infinity=False))),
    share=0.3,
)
def test_a_recognizer_stays_in_its_range_whatever_is_predicted(refine, rows, shift):
    system = mff.PoseRecognizer(tracker=tracker(refine))
    context = system.CreateDefaultContext()
    for name in ("right", "left"):
        image = picture(WIDTH, HEIGHT)
        system.GetInputPort(f"color_image_{name}").FixValue(context, image)
    if shift is not None:
        system.GetInputPort("X_WC").FixValue(context, RigidTransform(shift))
    state = context.get_mutable_discrete_state()
    system.CalcForcedDiscreteVariableUpdate(context, state)
    population = np.resize(np.concatenate(rows), 6 * system.num_hypotheses)
    for _ in range(2):
        system.GetInputPort("predicted_population").FixValue(context, population)
        if refused(system.CalcForcedDiscreteVariableUpdate, context, state)[1]:
            return
        fitness = system.GetOutputPort("population_fitness").Eval(context)
        assert ((fitness >= 0.0) & (fitness <= 1.0)).all()
        pose = system.GetOutputPort("pose").Eval(context)
        assert (np.abs(pose) < 1e4).all(), pose
        assert np.linalg.norm(pose[3:]) <= 1.0 + 1e-9
        assert system.GetOutputPort("X_CM").Eval(context).IsExactlyEqualTo(mff_transform(pose))


def mff_transform(pose):
    """The pose as Drake has it."""
    from pydrake.math import RotationMatrix

    R, p = mff.transform_from_pose(pose)
    return RigidTransform(RotationMatrix(R), p)


@functools.cache
def servo():
    return mff.VisualServoController(
        plant=MakePa10Plant(), X_CM=RigidTransform([0, 0, 0.8]), start=NOMINAL_POSITIONS
    )


@prop(vectors(3, st.floats(-2.0, 2.0)), VELOCITY, st.one_of(ODD_NUMBERS, st.sampled_from([0, 1])))
def test_a_servo_gives_numbers_or_names_the_port(place, velocity, is_known):
    system = servo()
    context = system.CreateDefaultContext()
    system.GetInputPort("X_WM").FixValue(context, RigidTransform(place))
    system.GetInputPort("target_velocity").FixValue(context, velocity)
    system.GetInputPort("is_known").FixValue(context, [is_known])
    state = context.get_mutable_discrete_state()
    for _ in range(2):
        if refused(system.CalcForcedDiscreteVariableUpdate, context, state)[1]:
            return
        assert np.isfinite(system.GetOutputPort("desired_state").Eval(context)).all()
