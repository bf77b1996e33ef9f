"""Each disturbance does to real images what it says, the same for whoever reads them, when ever."""

import math

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition import CameraRig
from mffdrake.recognition.parameters import (
    ParameterError,
    kind_of,
    parameters,
    plain,
    read_parameters,
)
from mffdrake.systems.cameras.stereo_camera import AddStereoCamera
from mffdrake.systems.disturbances import (
    DISTURBANCES,
    AddDisturbances,
    Black,
    Brightness,
    ColorTemperature,
    Disturbance,
    DroppedFrames,
    Frozen,
    GaussianNoise,
    LateFrames,
    MotionBlur,
    SaltAndPepper,
)
from mffdrake.systems.disturbances.image_disturbance import PixelFilter
from mffdrake.systems.random_stream import RandomStream
from mffdrake.systems.rendering.renderers import AddRenderer
from mffdrake.systems.timing import Timing

TIMING = Timing(control_period=0.001, vision_period=0.010)
RIG = CameraRig.stereo(width=64, height=48, focal_length=60.0, baseline=0.150)
SPEED = 2.0  # m/s, 1.5 px a frame


class Reader(LeafSystem):
    """Keeps what it reads in its discrete updates at frames, as the recognizer does."""

    def __init__(self):
        super().__init__()
        self.image = self.DeclareAbstractInputPort("image", AbstractValue.Make(ImageRgba8U()))
        self.seen = {}
        self.DeclarePeriodicDiscreteUpdateEvent(TIMING.control_period, 0.0, self.read)

    def read(self, context, discrete_state):
        time = context.get_time()
        if TIMING.IsVisionTick(time):
            self.seen[TIMING.Tick(time)] = self.image.Eval(context).data.copy()


class Scene:
    """A box that flies through the view of a rig, whose images are disturbed.

    Args:
        disturbances: In their order.
        seed: Of their random numbers.
    """

    def __init__(self, *disturbances, seed=1):
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(time_step=TIMING.control_period, use_sampled_output_ports=False),
            builder,
        )
        box = plant.AddRigidBody("box", SpatialInertia(1.0, [0, 0, 0], UnitInertia.SolidCube(0.1)))
        shape = Box(0.15, 0.1, 0.1)
        plant.RegisterVisualGeometry(box, RigidTransform(), shape, "box", [1.0, 0.4, 0.2, 1.0])
        for camera in RIG.cameras:
            X_CK = RigidTransform(camera.p_CK)
            plant.AddFrame(FixedOffsetFrame(f"camera_{camera.name}", plant.world_frame(), X_CK))
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
        plant.Finalize()
        AddRenderer(scene_graph, "flat")
        stereo = AddStereoCamera(
            builder, plant=plant, scene_graph=scene_graph, rig=RIG, renderer="flat"
        )
        self.clear = {name: stereo.GetOutputPort(f"color_image_{name}") for name in RIG.names}
        self.disturbed = AddDisturbances(
            builder, self.clear, disturbances, seed=seed, timing=TIMING
        )
        self.readers = {}
        for name, port in self.disturbed.items():
            self.readers[name] = builder.AddNamedSystem(f"reader_{name}", Reader())
            builder.Connect(port, self.readers[name].get_input_port())
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        X_WB = RigidTransform(RollPitchYaw(0.2, 0.3, 0.4), [-0.2, 0.0, 0.8])
        plant.SetFreeBodyPose(plant_context, box, X_WB)
        V_WB = SpatialVelocity(w=[0.0, 0.0, 0.0], v=[SPEED, 0.0, 0.0])
        plant.SetFreeBodySpatialVelocity(plant_context, box, V_WB)

    def read(self, port, context=None):
        context = self.context if context is None else context
        return port.Eval(port.get_system().GetMyContextFromRoot(context)).data.copy()

    def run(self, num_ticks, *, camera="right", every=1):
        """The clear and the disturbed images of a camera just before the ticks' updates.

        After each of the ticks, what the reader saw in the updates is found to be the same.
        """
        clear, disturbed = {}, {}
        for tick in range(TIMING.Tick(self.context.get_time()), num_ticks):
            if tick == 0:
                self.simulator.Initialize()  # Drake's AdvanceTo(0) would make the updates at 0.
            else:
                self.simulator.AdvanceTo(TIMING.TimeOfTick(tick))
            if tick % every == 0:
                clear[tick] = self.read(self.clear[camera])
                disturbed[tick] = self.read(self.disturbed[camera])
        for tick, image in self.readers[camera].seen.items():
            if tick in disturbed:
                np.testing.assert_array_equal(image, disturbed[tick], err_msg=f"tick {tick}")
        return clear, disturbed


def frames(num_frames, *disturbances, camera="right", seed=1):
    """The clear and the disturbed images at frames, in a list each."""
    clear, disturbed = Scene(*disturbances, seed=seed).run(
        10 * (num_frames - 1) + 1, camera=camera, every=10
    )
    return list(clear.values()), list(disturbed.values())


def which(disturbed, clear):
    """For each of the disturbed images, the number of the clear one that it is."""
    return [next(k for k, c in enumerate(clear) if np.array_equal(c, d)) for d in disturbed]


def disturb(disturbance, colors, time=0.0, *, index=0, camera="right", seed=0):
    """What the system makes of an image at a time, by the port."""
    stream = RandomStream(seed=seed, index=index, name=camera)
    system = PixelFilter(disturbance, stream=stream, timing=TIMING)
    context = system.CreateDefaultContext()
    context.SetTime(time)
    image = ImageRgba8U(colors.shape[1], colors.shape[0])
    image.mutable_data[..., :3] = colors
    image.mutable_data[..., 3] = 77
    system.get_input_port().FixValue(context, image)
    disturbed = system.get_output_port().Eval(context).data.copy()
    assert (disturbed[..., 3] == 77).all()
    return disturbed[..., :3]


GREY = np.full((60, 80, 3), 128, dtype=np.uint8)


# What all have in common.


def test_the_scene_changes_from_frame_to_frame():
    """What the tests below rest on."""
    clear, disturbed = frames(8)
    np.testing.assert_array_equal(clear, disturbed)
    assert which(clear, clear) == list(range(8))


@parameters
class Setup:
    disturbances: tuple[Disturbance, ...] = ()


@pytest.mark.parametrize("cls", DISTURBANCES)
def test_each_is_read_from_its_name_or_tag_and_written_again(cls):
    by_name = read_parameters(Setup, {"disturbances": [kind_of(cls)]})
    assert by_name == Setup(disturbances=(cls(),))
    changed = Setup(disturbances=(cls(cameras=["left"]),))
    assert read_parameters(Setup, plain(changed)) == changed


@pytest.mark.parametrize("cls", DISTURBANCES)
def test_whoever_reads_sees_the_same_before_and_after_the_updates_of_a_tick(cls):
    scene = Scene(cls())
    _, disturbed = scene.run(61)  # compares them with what the readers saw
    scene.simulator.AdvancePendingEvents()
    seen = scene.readers["right"].seen
    assert sorted(seen) == list(range(0, 70, 10))
    np.testing.assert_array_equal(seen[60], disturbed[60])


@pytest.mark.parametrize("cls", DISTURBANCES)
def test_the_state_is_all_in_the_context(cls):
    """A context that is copied in the middle goes on as the original does."""
    scene = Scene(cls())
    scene.run(34)
    copy = scene.context.Clone()
    _, expected = scene.run(61)
    again = Simulator(scene.diagram, copy)
    again.Initialize()
    for tick in (40, 50, 60):
        again.AdvanceTo(TIMING.TimeOfTick(tick))
        np.testing.assert_array_equal(
            scene.read(scene.disturbed["right"], again.get_context()), expected[tick]
        )


@pytest.mark.parametrize("cls", DISTURBANCES)
def test_a_camera_that_is_not_named_is_left_alone(cls):
    scene = Scene(cls(cameras=["left"]))
    assert scene.disturbed["right"] is scene.clear["right"]
    assert scene.disturbed["left"].get_system().get_name() == f"{kind_of(cls)}_left"


def test_two_of_a_kind_have_names_and_random_numbers_of_their_own():
    scene = Scene(GaussianNoise(), GaussianNoise())
    names = [system.get_name() for system in scene.diagram.GetSystems()]
    assert {"gaussian_noise_right", "gaussian_noise_1_right"} <= set(names)
    black = np.full((48, 64, 3), 128, dtype=np.uint8)
    first, second = (disturb(GaussianNoise(), black, index=k).astype(float) for k in (0, 1))
    correlation = np.corrcoef(first.ravel(), second.ravel())[0, 1]
    assert abs(correlation) < 5 / math.sqrt(first.size)


def test_they_follow_each_other_in_their_order():
    half, noise = Brightness(offset=-0.5, amplitude=0.0), Black(starts=[0.0])
    _, (image,) = frames(1, half, SaltAndPepper(share=1.0))
    assert set(np.unique(image[..., :3])) == {0, 255}
    _, (image,) = frames(1, SaltAndPepper(share=1.0), half)
    assert set(np.unique(image[..., :3])) == {0, 128}
    _, (image,) = frames(1, SaltAndPepper(share=1.0), half, noise)
    assert not image[..., :3].any()


@pytest.mark.parametrize("disturbance", [GaussianNoise(), SaltAndPepper(share=0.5)])
def test_errors_depend_on_seed_index_camera_and_tick_alone(disturbance):
    first = disturb(disturbance, GREY, 0.010)
    np.testing.assert_array_equal(disturb(disturbance, GREY, 0.010), first)
    for other in ({"time": 0.020}, {"index": 1}, {"camera": "left"}, {"seed": 1}):
        again = disturb(disturbance, GREY, **({"time": 0.010} | other)).astype(float)
        correlation = np.corrcoef(first.ravel(), again.ravel())[0, 1]
        assert abs(correlation) < 5 / math.sqrt(first.size / 3), other


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Brightness(amplitude=1.5), "Brightness: amplitude must be at most 1 . offset, wh"),
        (lambda: ColorTemperature(offset=-0.8), "amplitude must be at most 1 - .offset., which is"),
        (lambda: GaussianNoise(deviation=-1), "GaussianNoise: deviation must be at least 0, not"),
        (lambda: SaltAndPepper(share=2.0), "SaltAndPepper: share must be at most 1, not 2.0"),
        (lambda: Black(starts=1.0), "Black: starts must be a list, not 1.0"),
        (lambda: LateFrames(frames=0), "LateFrames: frames must be at least 1, not 0"),
        (lambda: Frozen(duration=0.0), "Frozen: duration must be positive, not 0"),
    ],
)
def test_wrong_parameters_are_named(make, message):
    with pytest.raises(ParameterError, match=message):
        make()


@pytest.mark.parametrize("exposure", [0.0005, 0.011])
def test_an_exposure_that_the_periods_do_not_allow_is_named(exposure):
    with pytest.raises(ValueError) as caught:
        Scene(MotionBlur(exposure=exposure))
    assert str(caught.value) == (
        "motion_blur: exposure must be a whole multiple of the control period of 0.001 s, up to "
        f"the vision period of 0.01 s, not {exposure} s"
    )


def test_a_camera_that_there_is_not_is_named():
    with pytest.raises(ValueError) as caught:
        Scene(Black(), GaussianNoise(cameras=["left", "top"]))
    message = "disturbance 1, gaussian_noise: cameras must be some of right, left, not 'top'"
    assert str(caught.value) == message


# Pixels.


def test_gaussian_noise_has_its_deviation_and_no_correlation():
    errors = disturb(GaussianNoise(deviation=7.0), GREY) - 128.0
    n = errors.size
    # Rounding adds the variance of one step, 1/12. Five standard deviations of mean and spread.
    spread = math.sqrt(7.0**2 + 1.0 / 12.0)
    assert abs(errors.mean()) < 5 * spread / math.sqrt(n)
    assert errors.std() == pytest.approx(spread, abs=5 * spread / math.sqrt(2 * n))
    for a, b in (
        (errors[:, 1:], errors[:, :-1]),
        (errors[1:], errors[:-1]),
        (errors[..., 0], errors[..., 1]),
        (errors[..., 1], errors[..., 2]),
    ):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 5 / math.sqrt(a.size)


def test_gaussian_noise_ends_at_black_and_white():
    white = disturb(GaussianNoise(deviation=20.0), np.full_like(GREY, 255))
    black = disturb(GaussianNoise(deviation=20.0), np.zeros_like(GREY))
    for image, level in ((white, 255), (black, 0)):
        share = (image == level).mean()  # half of the errors, and those below half a level
        expected = 0.5 + 0.5 * math.erf(0.5 / 20.0 / math.sqrt(2.0))
        assert share == pytest.approx(expected, abs=5 * 0.5 / math.sqrt(image.size))


def test_salt_and_pepper_are_as_many_as_told_and_leave_the_others():
    image = disturb(SaltAndPepper(share=0.1), GREY)
    n = GREY.size // 3
    for level in (0, 255):
        number = (image == level).all(axis=2).sum()
        assert number == pytest.approx(0.05 * n, abs=5 * math.sqrt(n * 0.05 * 0.95))
    touched = (image != 128).any(axis=2)
    assert (image[touched] != 128).all()
    np.testing.assert_array_equal(disturb(SaltAndPepper(share=0.0), GREY), GREY)
    assert not (disturb(SaltAndPepper(share=1.0), GREY) == 128).any()


RAMP = np.tile(np.arange(256, dtype=np.uint8)[None, :, None], (2, 1, 3))


def test_brightness_is_a_gain_that_swings():
    light = Brightness(offset=0.1, amplitude=0.4, period=2.0)
    for time, gain in ((0.0, 1.1), (0.5, 1.5), (1.0, 1.1), (1.5, 0.7), (2.5, 1.5)):
        expected = np.minimum(RAMP * gain, 255.0)
        assert np.abs(disturb(light, RAMP, time) - expected).max() <= 0.5 + 1e-9


def test_color_temperature_moves_red_and_blue_apart():
    light = ColorTemperature(offset=0.1, amplitude=0.2, period=2.0)
    for time, s in ((0.0, 0.1), (0.5, 0.3), (1.5, -0.1)):
        expected = np.minimum(RAMP * np.array([1.0 + s, 1.0, 1.0 - s]), 255.0)
        assert np.abs(disturb(light, RAMP, time) - expected).max() <= 0.5 + 1e-9


def test_images_are_black_in_the_intervals_and_clear_outside():
    clear, disturbed = frames(10, Black(starts=[0.020, 0.060], duration=0.020))
    for k, (c, d) in enumerate(zip(clear, disturbed, strict=True)):
        expected = c if k not in (2, 3, 6, 7) else np.broadcast_to([0, 0, 0, 255], c.shape)
        np.testing.assert_array_equal(d, expected)


# Images of other times.


@pytest.mark.parametrize("exposure", [0.0, 0.001, 0.004, 0.010])
def test_motion_blur_is_the_mean_of_the_images_while_the_shutter_is_open(exposure):
    clear, disturbed = Scene(MotionBlur(exposure=exposure)).run(41)
    number = round(exposure / 0.001)
    for tick in range(0, 41, 10):
        images = [clear[k] for k in range(max(0, tick - number), tick + 1)]
        error = disturbed[tick] - np.mean(images, axis=0)
        assert np.abs(error).max() <= 0.5 + 1e-9
    if number > 1:
        assert not np.array_equal(disturbed[40], clear[40])


def test_motion_blur_takes_images_of_open_shutters_only():
    taken = [tick for tick in range(41) if MotionBlur(exposure=0.003).Takes(tick, TIMING)]
    assert taken == [k for k in range(41) if k % 10 in (0, 7, 8, 9)]


def test_between_frames_the_camera_delivers_the_last_ones_image():
    for disturbance in (MotionBlur(exposure=0.004), LateFrames(), Frozen(start=0.02)):
        _, disturbed = Scene(disturbance).run(40)
        for tick in range(40):
            np.testing.assert_array_equal(disturbed[tick], disturbed[tick - tick % 10])


def test_a_frozen_camera_delivers_the_last_image_before_it_hangs():
    clear, disturbed = frames(9, Frozen(start=0.030, duration=0.030))
    assert which(disturbed, clear) == [0, 1, 2, 2, 2, 2, 6, 7, 8]
    clear, disturbed = frames(5, Frozen(start=0.0, duration=0.025))
    assert which(disturbed, clear) == [0, 0, 0, 3, 4]


def test_a_dropped_frame_is_the_last_delivered_one_again():
    for probability, expected in ((0.0, [0, 1, 2, 3, 4]), (1.0, [0, 0, 0, 0, 0])):
        clear, disturbed = frames(5, DroppedFrames(probability=probability))
        assert which(disturbed, clear) == expected
    clear, disturbed = frames(20, DroppedFrames(probability=0.5))
    shown = which(disturbed, clear)
    for before, k, now in zip(shown, range(1, 20), shown[1:], strict=False):
        assert now in (k, before)
    assert shown != list(range(20))


def count_drops(probability, *, name="right", seed=0, number=2000):
    stream = RandomStream(seed=seed, index=0, name=name)
    camera = DroppedFrames(probability=probability)
    ticks = [10 * k for k in range(1, number)]
    return np.array([camera.Shown([0, tick], stream, TIMING) == [0] for tick in ticks])


def test_frames_are_dropped_with_their_probability_by_each_camera_for_itself():
    right, left = count_drops(0.3), count_drops(0.3, name="left")
    n = len(right)
    for drops in (right, left):
        assert drops.mean() == pytest.approx(0.3, abs=5 * math.sqrt(0.3 * 0.7 / n))
    for a, b in ((right, left), (right[1:], right[:-1])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 5 / math.sqrt(n)


@pytest.mark.parametrize("number", [1, 3])
def test_late_frames_are_so_many_frames_late(number):
    clear, disturbed = frames(7, LateFrames(frames=number))
    assert which(disturbed, clear) == [max(0, k - number) for k in range(7)]


def test_frames_late_at_random_are_never_older_than_the_one_before():
    clear, disturbed = frames(25, LateFrames(frames=3, probability=0.6), seed=4)
    shown = which(disturbed, clear)
    delays = np.arange(25) - shown
    assert (np.diff(shown) >= 0).all()
    assert delays.min() == 0 and 1 <= delays.max() <= 3


def test_a_late_frame_is_the_newest_that_has_arrived():
    """From the delays of single frames by brute force over all frames so far."""
    camera = LateFrames(frames=4, probability=0.7)
    stream = RandomStream(seed=3, index=0, name="right")
    ticks = [10 * k for k in range(400)]
    delays = [camera.Delay(tick, stream) for tick in ticks]
    late = np.array(delays) > 0
    assert late.mean() == pytest.approx(0.7, abs=5 * math.sqrt(0.7 * 0.3 / 400))
    np.testing.assert_allclose(
        np.bincount(delays, minlength=5)[1:] / late.sum(), 0.25, atol=5 * math.sqrt(0.19 / 280)
    )
    kept = []
    for k, tick in enumerate(ticks):
        shown = camera.Shown([*kept, tick], stream, TIMING)
        kept = list(camera.Kept([*kept, tick], stream, TIMING))
        assert shown == [10 * max(0, *(j - delays[j] for j in range(k + 1)), 0)]


# Cost.


class CountingCamera(LeafSystem):
    """Gives grey images, and keeps the ticks at which it did."""

    def __init__(self):
        super().__init__()
        self.ticks = []
        self.DeclareAbstractOutputPort(
            "image", lambda: AbstractValue.Make(ImageRgba8U(8, 6, 128)), self.calc
        )

    def calc(self, context, output):
        self.ticks.append(TIMING.Tick(context.get_time()))


def test_an_image_is_taken_once_a_frame_and_oftener_only_while_a_shutter_is_open():
    for kinds, expected in (
        ([cls for cls in DISTURBANCES if cls is not MotionBlur], [0, 10, 20, 30]),
        ([lambda: MotionBlur(exposure=0.002)], [0, 8, 9, 10, 18, 19, 20, 28, 29, 30]),
    ):
        builder = DiagramBuilder()
        camera = builder.AddSystem(CountingCamera())
        images = {"right": camera.get_output_port()}
        disturbed = AddDisturbances(builder, images, [kind() for kind in kinds], timing=TIMING)
        reader = builder.AddSystem(Reader())
        builder.Connect(disturbed["right"], reader.get_input_port())
        Simulator(builder.Build()).AdvanceTo(0.035)
        assert camera.ticks == expected
        assert sorted(reader.seen) == [0, 10, 20, 30]
