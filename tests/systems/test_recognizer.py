"""The recognizer adapts the pure tracker to Drake, to the last bit, and keeps its state in numbers.

The images are a box drawn pixel by pixel: flat colors on grey.
"""

import colorsys
import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    BorderRefiner,
    CameraRig,
    Generation,
    GeneticParameters,
    Matcher,
    NearStart,
    OneStepGaTracker,
    SearchModel,
    SearchRange,
    SolidModel,
)
from mffdrake.recognition.poses.pose_filter import NUM_NUMBERS
from mffdrake.systems.arms.pa10 import NOMINAL_POSITIONS, MakePa10Plant
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.predictor import MffPredictor
from mffdrake.systems.vision.recognizer import OneStepGaRecognizer, PoseRecognizer

N = 20
RIG = CameraRig.stereo(width=160, height=120, focal_length=145.0)
CAMERA = RIG.cameras[0]
BOX = SolidModel.box((0.100, 0.150, 0.200), (RED, GREEN, BLUE))
START = np.array([0.0, 0.155, 0.8, 0.1, -0.2, 0.05])


def make_tracker(**arguments):
    return OneStepGaTracker(
        matcher=Matcher(SearchModel(BOX), RIG),
        parameters=GeneticParameters(population_size=N),
        **{"start": NearStart(START)} | arguments,
    )


def true_pose(time):
    """The drawn box's motion: 0.2 m/s to the right while it turns."""
    return START + time * np.array([0.2, -0.05, 0.1, 0.1, 0.3, 0.2])


def inside(polygon):
    """Which pixels' centers lie inside a convex polygon, shape (height, width)."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    side = np.roll(polygon, -1, axis=0) - polygon
    left_of = [s[0] * (v - p[1]) > s[1] * (u - p[0]) for p, s in zip(polygon, side, strict=True)]
    return np.all(left_of, axis=0) | ~np.any(left_of, axis=0)


def draw(pose):
    """The right and the left image of the box: RGBA, shape (height, width, 4)."""
    eps = pose[3:]
    R = RotationMatrix(Quaternion(wxyz=[np.sqrt(1.0 - eps @ eps), *eps])).matrix()
    corners = BOX.vertices @ R.T + pose[:3]
    images = []
    for camera, pixels in zip(RIG.cameras, RIG.project(corners), strict=True):
        image = np.full((CAMERA.height, CAMERA.width, 4), (128, 128, 128, 255), dtype=np.uint8)
        toward = BOX.centers @ R.T + pose[:3] - camera.p_CK
        for face in np.flatnonzero(np.einsum("fk,fk->f", BOX.normals @ R.T, toward) < 0.0):
            color = 255 * np.array(colorsys.hsv_to_rgb(BOX.hues[face] / (2.0 * np.pi), 1.0, 1.0))
            image[inside(pixels[list(BOX.faces[face])])] = (*np.rint(color), 255)
        images.append(image)
    return tuple(images)


def to_drake(image):
    result = ImageRgba8U(image.shape[1], image.shape[0])
    result.mutable_data[:] = image
    return result


def fix_images(recognizer, context, pose):
    """Shows the recognizer a pose; returns the images."""
    images = draw(pose)
    for side, image in zip(("right", "left"), images, strict=True):
        recognizer.GetInputPort(f"color_image_{side}").FixValue(context, to_drake(image))
    return images


def take_frame(system, context):
    system.CalcForcedDiscreteVariableUpdate(context, context.get_mutable_discrete_state())


def outputs(recognizer, context):
    """All numeric outputs by name."""
    names = ("pose", "fitness", "population", "population_fitness", "frame_time")
    return {name: recognizer.GetOutputPort(name).Eval(context) for name in names}


def state(context):
    """All numbers in the discrete state."""
    groups = context.get_discrete_state()
    return np.concatenate([groups.value(i) for i in range(groups.num_groups())])


class DrawnCamera(LeafSystem):
    """Draws the box's motion; counts how often each image is computed."""

    def __init__(self):
        super().__init__()
        self.rendered = {"right": [], "left": []}
        for index, side in enumerate(("right", "left")):
            self.DeclareAbstractOutputPort(
                f"color_image_{side}",
                lambda: AbstractValue.Make(ImageRgba8U()),
                lambda context, output, index=index, side=side: self._draw(
                    context.get_time(), output, index, side
                ),
                {self.time_ticket()},
            )

    def _draw(self, time, output, index, side):
        self.rendered[side].append(time)
        output.set_value(to_drake(draw(true_pose(time))[index]))


def make_diagram(tracker=None, timing=None):
    """A recognizer that sees the drawn box: (diagram, recognizer, camera)."""
    builder = DiagramBuilder()
    camera = builder.AddSystem(DrawnCamera())
    recognizer = builder.AddSystem(
        OneStepGaRecognizer(tracker=make_tracker() if tracker is None else tracker, timing=timing)
    )
    for side in ("right", "left"):
        name = f"color_image_{side}"
        builder.Connect(camera.GetOutputPort(name), recognizer.GetInputPort(name))
    return builder.Build(), recognizer, camera


# One frame.


def test_before_the_first_frame_the_pose_is_the_middle_of_the_search_range():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    values = outputs(recognizer, context)
    search_range = SearchRange()
    middle = 0.5 * (search_range.lower + search_range.upper)
    np.testing.assert_allclose(values["pose"], middle, atol=1e-15)
    np.testing.assert_array_equal(values["population"], np.tile(values["pose"], N))
    np.testing.assert_array_equal(values["population_fitness"], np.zeros(N))
    np.testing.assert_array_equal(values["fitness"], [0.0])
    np.testing.assert_array_equal(values["frame_time"], [np.nan])
    X_CM = recognizer.GetOutputPort("X_CM").Eval(context)
    assert X_CM.IsNearlyEqualTo(RigidTransform(middle[:3]), 1e-12)


def test_a_frame_scores_the_population_on_its_images_and_sorts_it():
    tracker = make_tracker()
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    images = fix_images(recognizer, context, START)
    for time in (1.5, 1.6):  # the first frame, and one like all the others
        context.SetTime(time)
        take_frame(recognizer, context)
        values = outputs(recognizer, context)
        np.testing.assert_array_equal(values["frame_time"], [time])
        poses = values["population"].reshape(N, 6)
        fitness = values["population_fitness"]
        np.testing.assert_array_equal(fitness, tracker.matcher.fitness(poses, images))
        np.testing.assert_array_equal(fitness, np.sort(fitness)[::-1])
        assert fitness[0] > fitness[-1]
        np.testing.assert_array_equal(values["pose"], poses[0])
        np.testing.assert_array_equal(values["fitness"], fitness[:1])


def test_x_cm_is_the_pose_as_a_transform():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    fix_images(recognizer, context, START)
    take_frame(recognizer, context)
    pose = recognizer.GetOutputPort("pose").Eval(context)
    X_CM = recognizer.GetOutputPort("X_CM").Eval(context)
    q = X_CM.rotation().ToQuaternion()
    np.testing.assert_array_equal(X_CM.translation(), pose[:3])
    np.testing.assert_allclose(q.xyz() * np.sign(q.w()), pose[3:], atol=1e-12)


def test_a_box_at_rest_is_found_from_nowhere():
    tracker = OneStepGaTracker(matcher=Matcher(SearchModel(BOX), RIG))
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    fix_images(recognizer, context, START)
    for _ in range(100):
        take_frame(recognizer, context)
    assert recognizer.GetOutputPort("fitness").Eval(context) > 0.95
    # In so small an image the depth stays vague.
    error = np.abs(recognizer.GetOutputPort("pose").Eval(context) - START)
    assert np.all(error < [0.01, 0.01, 0.05, 0.05, 0.05, 0.05])


def test_a_forced_update_into_other_values_leaves_the_context_alone():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    fix_images(recognizer, context, START)
    before = state(context)
    updated = recognizer.AllocateDiscreteVariables()
    recognizer.CalcForcedDiscreteVariableUpdate(context, updated)
    np.testing.assert_array_equal(state(context), before)
    context.SetDiscreteState(updated)
    assert recognizer.GetOutputPort("fitness").Eval(context) > 0.0


# The same numbers as the pure tracker.


@pytest.mark.parametrize("generations", [1, 3])
def test_frame_by_frame_it_is_the_pure_tracker(generations):
    tracker = make_tracker(generations_per_frame=generations, seed=5)
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    generation = None
    for frame in range(8):
        images = fix_images(recognizer, context, true_pose(0.033 * frame))
        take_frame(recognizer, context)
        if frame == 0:
            generation = tracker.start_population(images)
        else:
            generation = tracker.track(generation, images, frame=frame)
        values = outputs(recognizer, context)
        np.testing.assert_array_equal(values["population"], generation.poses.ravel())
        np.testing.assert_array_equal(values["population_fitness"], generation.fitness)


def test_with_a_prediction_it_is_the_pure_tracker_on_the_predicted_poses():
    tracker = make_tracker()
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    rng = np.random.default_rng(1)
    generation = None
    for frame in range(8):
        images = fix_images(recognizer, context, true_pose(0.033 * frame))
        predicted = true_pose(0.033 * frame) + 0.02 * rng.standard_normal((N, 6))
        recognizer.GetInputPort("predicted_population").FixValue(context, predicted.ravel())
        take_frame(recognizer, context)
        if frame == 0:  # There is nothing to predict from yet.
            generation = tracker.start_population(images)
        else:
            last = Generation(predicted, generation.fitness)
            generation = tracker.track(last, images, frame=frame)
        values = outputs(recognizer, context)
        np.testing.assert_array_equal(values["population"], generation.poses.ravel())
        np.testing.assert_array_equal(values["population_fitness"], generation.fitness)


def test_a_right_prediction_keeps_what_would_be_lost_without():
    """The box jumps by 60 mm between two frames, and the hypotheses jump with it or not."""
    jump = np.array([-0.06, 0.03, 0.0, 0.0, 0.0, 0.0])
    fitness = {}
    for carried in (False, True):
        recognizer = OneStepGaRecognizer(tracker=make_tracker())
        context = recognizer.CreateDefaultContext()
        fix_images(recognizer, context, START)
        for _ in range(30):
            take_frame(recognizer, context)
        fix_images(recognizer, context, START + jump)
        if carried:
            population = recognizer.GetOutputPort("population").Eval(context)
            predicted = population + np.tile(jump, N)
            recognizer.GetInputPort("predicted_population").FixValue(context, predicted)
        take_frame(recognizer, context)
        fitness[carried] = recognizer.GetOutputPort("fitness").Eval(context)[0]
    assert fitness[True] > fitness[False] + 0.3


def test_in_a_simulation_it_is_the_pure_tracker_too():
    tracker = make_tracker()
    diagram, recognizer, _ = make_diagram(tracker)
    simulator = Simulator(diagram)
    generation = tracker.start_population(draw(true_pose(0.0)))
    for frame in range(1, 6):
        images = draw(true_pose(Timing().TimeOfFrame(frame)))
        generation = tracker.track(generation, images, frame=frame)
    simulator.AdvanceTo(0.17)
    values = outputs(recognizer, recognizer.GetMyContextFromRoot(simulator.get_context()))
    np.testing.assert_array_equal(values["population"], generation.poses.ravel())
    np.testing.assert_array_equal(values["frame_time"], [0.165])


# As a Drake system.


def test_outputs_depend_on_the_state_only():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    assert not recognizer.HasAnyDirectFeedthrough()
    for k in range(recognizer.num_output_ports()):
        assert not recognizer.HasDirectFeedthrough(k)


def test_the_prediction_may_depend_on_the_population():
    """No algebraic loop: the diagram builds and runs with its own population fed back."""
    tracker = make_tracker()
    builder = DiagramBuilder()
    recognizer = builder.AddSystem(OneStepGaRecognizer(tracker=tracker))
    population = recognizer.GetOutputPort("population")
    builder.Connect(population, recognizer.GetInputPort("predicted_population"))
    for side in ("right", "left"):
        builder.ExportInput(recognizer.GetInputPort(f"color_image_{side}"), side)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    alone = OneStepGaRecognizer(tracker=tracker)
    alone_context = alone.CreateDefaultContext()
    for frame in range(3):
        images = fix_images(alone, alone_context, true_pose(0.033 * frame))
        for side, image in zip(("right", "left"), images, strict=True):
            diagram.GetInputPort(side).FixValue(context, to_drake(image))
        take_frame(diagram, context)
        take_frame(alone, alone_context)
    np.testing.assert_array_equal(state(context), state(alone_context))


@pytest.mark.parametrize("missing", ["right", "left"])
def test_a_missing_image_is_an_error_that_names_the_port(missing):
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    recognizer.set_name("eyes")
    context = recognizer.CreateDefaultContext()
    other = {"right": "left", "left": "right"}[missing]
    recognizer.GetInputPort(f"color_image_{other}").FixValue(context, to_drake(draw(START)[0]))
    message = f"eyes: input port 'color_image_{missing}' is not connected"
    with pytest.raises(RuntimeError, match=message):
        take_frame(recognizer, context)
    with pytest.raises(RuntimeError, match=message):
        Simulator(recognizer, context).AdvanceTo(0.001)


def test_images_of_another_size_than_the_cameras_are_an_error():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    for side in ("right", "left"):
        recognizer.GetInputPort(f"color_image_{side}").FixValue(context, ImageRgba8U(64, 48))
    with pytest.raises(ValueError, match=r"\(120, 160, 3 or 4\)"):
        take_frame(recognizer, context)


# Refinement


def test_without_a_refiner_there_is_no_covariance():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    fix_images(recognizer, context, START)
    take_frame(recognizer, context)
    covariance = recognizer.GetOutputPort("pose_covariance").Eval(context)
    assert covariance.shape == (36,) and np.isnan(covariance).all()


def test_a_refined_pose_and_its_covariance_are_the_trackers():
    tracker = make_tracker()
    tracker = make_tracker(refiner=BorderRefiner(tracker.matcher))
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    assert np.isnan(recognizer.GetOutputPort("pose_covariance").Eval(context)).all()
    generation = None
    for frame in range(4):
        images = fix_images(recognizer, context, true_pose(0.03 * frame))
        take_frame(recognizer, context)
        if frame == 0:
            generation = tracker.start_population(images)
        else:
            generation = tracker.track(generation, images, frame=frame)
        covariance = recognizer.GetOutputPort("pose_covariance").Eval(context).reshape(6, 6)
        pose = recognizer.GetOutputPort("pose").Eval(context)
        np.testing.assert_array_equal(pose, generation.best)
        np.testing.assert_array_equal(covariance, generation.covariance)
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
        assert np.linalg.norm(pose[:3] - true_pose(0.03 * frame)[:3]) < 0.003


def test_a_frame_that_cannot_be_refined_has_no_covariance():
    tracker = make_tracker()
    tracker = make_tracker(refiner=BorderRefiner(tracker.matcher))
    recognizer = OneStepGaRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    fix_images(recognizer, context, START)
    take_frame(recognizer, context)
    assert np.isfinite(recognizer.GetOutputPort("pose_covariance").Eval(context)).all()
    for side in ("right", "left"):
        grey = to_drake(np.full((CAMERA.height, CAMERA.width, 4), 128, dtype=np.uint8))
        recognizer.GetInputPort(f"color_image_{side}").FixValue(context, grey)
    take_frame(recognizer, context)
    assert np.isnan(recognizer.GetOutputPort("pose_covariance").Eval(context)).all()


def test_all_of_its_state_is_discrete_numbers():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    context = recognizer.CreateDefaultContext()
    assert context.num_abstract_states() == 0
    assert context.num_continuous_states() == 0
    # Poses, fitness; number, time; covariance; white balance; verdict; motion; images; cameras
    assert len(state(context)) == 7 * N + 2 + 36 + 3 + 4 + NUM_NUMBERS + 2 + 12
    assert recognizer.num_hypotheses == N


@pytest.mark.parametrize(
    ("timing", "times"),
    [
        (None, [0.0, 0.033, 0.066, 0.099]),
        (Timing(control_period=0.002, vision_period=0.05), [0.0, 0.05]),
    ],
)
def test_images_are_read_at_its_own_frames_only(timing, times):
    diagram, recognizer, camera = make_diagram(timing=timing)
    simulator = Simulator(diagram)
    context = recognizer.GetMyContextFromRoot(simulator.get_context())

    def read_outputs(_):  # Readers of the outputs cause no rendering either.
        outputs(recognizer, context)
        recognizer.GetOutputPort("X_CM").Eval(context)

    simulator.set_monitor(read_outputs)
    simulator.AdvanceTo(0.1)
    assert camera.rendered == {"right": times, "left": times}


# The state lives in the context.


def test_a_simulation_repeats_itself_to_the_last_bit():
    diagram, _, _ = make_diagram()
    ends = []
    for _ in range(2):
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.2)
        ends.append(state(simulator.get_context()))
    np.testing.assert_array_equal(*ends)


def test_simulations_from_cloned_contexts_are_equal_to_the_last_bit():
    diagram, _, _ = make_diagram()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.08)
    half_way = state(simulator.get_context())
    clones = [simulator.get_context().Clone() for _ in range(2)]
    simulator.AdvanceTo(0.2)
    end = state(simulator.get_context())
    assert np.any(end != half_way)
    for clone in clones:
        np.testing.assert_array_equal(state(clone), half_way)
        Simulator(diagram, clone).AdvanceTo(0.2)
        np.testing.assert_array_equal(state(clone), end)


def test_two_contexts_of_one_recognizer_do_not_disturb_each_other():
    recognizer = OneStepGaRecognizer(tracker=make_tracker())
    poses = [true_pose(0.0), true_pose(0.5)]
    together = [recognizer.CreateDefaultContext() for _ in poses]
    for _ in range(4):
        for context, pose in zip(together, poses, strict=True):
            fix_images(recognizer, context, pose)
            take_frame(recognizer, context)
    for context, pose in zip(together, poses, strict=True):
        alone = recognizer.CreateDefaultContext()
        fix_images(recognizer, alone, pose)
        for _ in range(4):
            take_frame(recognizer, alone)
        np.testing.assert_array_equal(state(context), state(alone))


def test_another_seed_gives_another_population():
    ends = []
    for seed in (0, 1):
        recognizer = OneStepGaRecognizer(tracker=make_tracker(seed=seed))
        context = recognizer.CreateDefaultContext()
        fix_images(recognizer, context, START)
        take_frame(recognizer, context)
        ends.append(recognizer.GetOutputPort("population").Eval(context))
    assert np.any(ends[0] != ends[1])


# Any other tracker


@dc.dataclass(frozen=True)
class ColumnTracker:
    """Sees which column of the only image is the reddest; says so in the pose's x [px]."""

    rig: CameraRig = CameraRig(RIG.cameras[:1])  # noqa: RUF009
    num_hypotheses: int = 1
    initial_pose: np.ndarray = dc.field(default_factory=lambda: np.array([7.0, 0, 0.8, 0, 0, 0]))
    covariance: np.ndarray | None = None
    gains: tuple[float, ...] = (1.0, 1.0, 1.0)

    def start_population(self, images, *, frame):
        n = self.num_hypotheses
        start = Generation(np.tile(self.initial_pose, (n, 1)), np.zeros(n))
        return self.look(start, images)

    def track(self, generation, images, *, frame):
        return self.look(generation, images)

    def look(self, generation, images):
        poses, fitness = generation.poses.copy(), np.zeros(self.num_hypotheses)
        red = images[0][..., 0].sum(axis=0, dtype=float)
        if np.ptp(red) > 0:
            poses[0, 0], fitness[0] = np.argmax(red), 1.0
        return Generation(poses, fitness, self.covariance, self.gains)


def show_column(recognizer, context, column):
    """An image with one red column, or all black."""
    image = np.zeros((CAMERA.height, CAMERA.width, 4), dtype=np.uint8)
    if column is not None:
        image[:, column, 0] = 255
    recognizer.GetInputPort("color_image_right").FixValue(context, to_drake(image))


def test_there_is_an_image_port_for_each_camera_of_the_trackers_rig():
    recognizer = PoseRecognizer(tracker=ColumnTracker())
    assert recognizer.HasInputPort("color_image_right")
    assert not recognizer.HasInputPort("color_image_left")
    assert recognizer.num_hypotheses == 1
    assert recognizer.GetInputPort("predicted_population").size() == 6


def test_before_the_first_frame_the_pose_is_the_trackers_initial_one():
    tracker = ColumnTracker(num_hypotheses=3)
    recognizer = PoseRecognizer(tracker=tracker)
    values = outputs(recognizer, recognizer.CreateDefaultContext())
    np.testing.assert_array_equal(values["population"], np.tile(tracker.initial_pose, 3))
    np.testing.assert_array_equal(values["population_fitness"], np.zeros(3))


def test_any_tracker_takes_the_frames():
    recognizer = PoseRecognizer(tracker=ColumnTracker(covariance=2.0 * np.eye(6)))
    context = recognizer.CreateDefaultContext()
    for column in (11, 100, 0):
        show_column(recognizer, context, column)
        take_frame(recognizer, context)
        assert recognizer.GetOutputPort("pose").Eval(context)[0] == column
        assert recognizer.GetOutputPort("fitness").Eval(context) == 1.0
        covariance = recognizer.GetOutputPort("pose_covariance").Eval(context)
        np.testing.assert_array_equal(covariance.reshape(6, 6), 2.0 * np.eye(6))


def test_what_a_tracker_returns_comes_back_to_it_in_the_next_frame():
    class Remembering(ColumnTracker):
        def track(self, generation, images, *, frame):
            seen.append((frame, generation))
            return super().track(generation, images, frame=frame)

    seen = []
    recognizer = PoseRecognizer(
        tracker=Remembering(covariance=3.0 * np.eye(6), gains=(0.9, 1.0, 1.1))
    )
    context = recognizer.CreateDefaultContext()
    for column in (5, 6):
        show_column(recognizer, context, column)
        take_frame(recognizer, context)
    frame, last = seen[-1]
    assert frame == 1
    assert last.best[0] == 5.0 and last.fitness == 1.0
    assert last.gains == (0.9, 1.0, 1.1)
    np.testing.assert_array_equal(last.covariance, 3.0 * np.eye(6))


def test_a_tracker_may_write_on_what_it_is_given():
    class Overwriting(ColumnTracker):
        def track(self, generation, images, *, frame):
            result = super().track(generation, images, frame=frame)
            for array in (generation.poses, generation.fitness, generation.covariance):
                array[:] = 9.0
            return result

    recognizer = PoseRecognizer(tracker=Overwriting(covariance=np.eye(6)))
    context = recognizer.CreateDefaultContext()
    show_column(recognizer, context, 5)
    take_frame(recognizer, context)
    predicted = recognizer.GetOutputPort("pose").Eval(context).copy()
    recognizer.GetInputPort("predicted_population").FixValue(context, predicted)
    before = state(context)
    recognizer.CalcForcedDiscreteVariableUpdate(context, recognizer.AllocateDiscreteVariables())
    np.testing.assert_array_equal(state(context), before)
    carried = recognizer.GetInputPort("predicted_population").Eval(context)
    np.testing.assert_array_equal(carried, predicted)


def test_where_nothing_is_found_the_carried_pose_stays_with_fitness_0():
    recognizer = PoseRecognizer(tracker=ColumnTracker())
    context = recognizer.CreateDefaultContext()
    show_column(recognizer, context, 50)
    take_frame(recognizer, context)
    predicted = recognizer.GetOutputPort("pose").Eval(context) + 0.125
    recognizer.GetInputPort("predicted_population").FixValue(context, predicted)
    show_column(recognizer, context, None)
    take_frame(recognizer, context)
    np.testing.assert_array_equal(recognizer.GetOutputPort("pose").Eval(context), predicted)
    assert recognizer.GetOutputPort("fitness").Eval(context) == 0.0


def test_one_hypothesis_goes_through_the_predictor():
    """The arm's base turns while nothing is seen: the pose moves as the predictor says."""
    builder = DiagramBuilder()
    timing = Timing(vision_period=0.05)
    recognizer = builder.AddSystem(PoseRecognizer(tracker=ColumnTracker(), timing=timing))
    predictor = builder.AddSystem(
        MffPredictor(plant=MakePa10Plant(), num_hypotheses=1, timing=recognizer.timing)
    )
    population, predicted = "population", "predicted_population"
    builder.Connect(recognizer.GetOutputPort(population), predictor.GetInputPort(population))
    builder.Connect(predictor.GetOutputPort(predicted), recognizer.GetInputPort(predicted))
    builder.ExportInput(recognizer.GetInputPort("color_image_right"), "color_image_right")
    builder.ExportInput(predictor.GetInputPort("estimated_state"), "state")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    recognizer_context = recognizer.GetMyContextFromRoot(context)
    show_column(diagram, context, None)
    diagram.GetInputPort("state").FixValue(context, np.append(NOMINAL_POSITIONS, np.zeros(7)))
    take_frame(diagram, context)
    turned = NOMINAL_POSITIONS + np.eye(7)[0] * 0.01
    diagram.GetInputPort("state").FixValue(context, np.append(turned, np.zeros(7)))
    expected = predictor.GetOutputPort(predicted).Eval(predictor.GetMyContextFromRoot(context))
    expected = expected.copy()
    assert np.linalg.norm(expected - recognizer.tracker.initial_pose) > 0.01
    take_frame(diagram, context)
    pose = recognizer.GetOutputPort("pose").Eval(recognizer_context)
    np.testing.assert_array_equal(pose, expected)


@pytest.mark.parametrize("timing", [Timing(), Timing(control_period=0.002, vision_period=0.05)])
def test_its_timing_can_be_read(timing):
    assert PoseRecognizer(tracker=ColumnTracker(), timing=timing).timing == timing


def test_the_1_step_ga_is_a_tracker_like_any_other():
    tracker = make_tracker()
    contexts = []
    for recognizer in (OneStepGaRecognizer(tracker=tracker), PoseRecognizer(tracker=tracker)):
        context = recognizer.CreateDefaultContext()
        for frame in range(3):
            fix_images(recognizer, context, true_pose(0.033 * frame))
            take_frame(recognizer, context)
        contexts.append(context)
    np.testing.assert_array_equal(*(state(context) for context in contexts))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_hypotheses": 0}, "ColumnTracker: num_hypotheses must be at least 1, not 0"),
        ({"initial_pose": np.zeros(7)}, "ColumnTracker: initial_pose must be a pose vector of 6"),
        ({"initial_pose": np.full(6, np.nan)}, "initial_pose must be .* 6 finite numbers"),
    ],
)
def test_a_tracker_that_tells_no_sizes_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        PoseRecognizer(tracker=ColumnTracker(**changes))


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (
            {"poses": np.zeros(6)},
            r"poses of shape \(6,\); with num_hypotheses 1 it must be of shape \(1, 6\)",
        ),
        ({"poses": np.zeros((2, 6))}, r"poses of shape \(2, 6\); .* of shape \(1, 6\)"),
        ({"fitness": 0.5}, r"fitness of shape \(\); .* of shape \(1,\)"),
        ({"covariance": np.zeros(6)}, r"covariance of shape \(6,\); .* of shape \(6, 6\)"),
        ({"gains": (1.0,)}, r"gains of shape \(1,\); .* of shape \(3,\)"),
        ({"poses": np.full((1, 6), np.nan)}, "poses or fitness .* not finite; .* carried poses"),
        ({"fitness": np.array([np.inf])}, "poses or fitness .* not finite; .* with fitness 0"),
    ],
)
@pytest.mark.parametrize("method", ["start_population", "track"])
def test_wrong_arrays_from_a_tracker_are_told(method, returned, message):
    def return_wrong(self, *arguments, frame):
        return dc.replace(getattr(ColumnTracker, method)(self, *arguments, frame=frame), **returned)

    tracker = type("Wrong", (ColumnTracker,), {method: return_wrong})()
    recognizer = PoseRecognizer(tracker=tracker)
    context = recognizer.CreateDefaultContext()
    show_column(recognizer, context, 5)
    with pytest.raises(ValueError, match=rf"Wrong\.{method} returned {message}"):
        for _ in range(2):
            take_frame(recognizer, context)
