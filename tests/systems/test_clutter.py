"""Things move through the scene on the paths that their parameters tell, before both renderers."""

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    PerceptionProperties,
    RenderCameraCore,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from mffdrake.recognition import Camera
from mffdrake.recognition.fitness.colors import hue_chroma_value
from mffdrake.recognition.parameters import ParameterError, parameters, plain, read_parameters
from mffdrake.systems.cameras.camera_info import MakeCameraInfo
from mffdrake.systems.clutter import Clutter, Distractors, Occluder
from mffdrake.systems.rendering.renderers import AddRenderer

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
CAMERA = Camera(width=320, height=240, fx=290.0, fy=290.0, cx=159.5, cy=119.5)
X_CT = RigidTransform([0.0, 0.0, 0.8])
X_WC = RigidTransform(RollPitchYaw(0.3, -0.5, 0.2), [0.4, -0.3, 0.9])
"""A camera that stands askew; the target's axes are the camera's, 0.8 m ahead."""


class Scene:
    """Clutter and a red cube at the target's place, before a camera."""

    def __init__(self, *clutter, renderer="flat", seed=1):
        builder = DiagramBuilder()
        self.scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
        self.target = self.scene_graph.RegisterSource("target")
        X_WT = X_WC @ X_CT
        cube = GeometryInstance(X_WT, Box(0.1, 0.1, 0.1), "cube")
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", Rgba(*RED))
        cube.set_perception_properties(properties)
        self.scene_graph.RegisterAnchoredGeometry(self.target, cube)
        self.movers = [
            thing.AddToScene(
                builder, self.scene_graph, X_WT=X_WT, colors=(RED, GREEN, BLUE), index=k, seed=seed
            )
            for k, thing in enumerate(clutter)
        ]
        AddRenderer(self.scene_graph, renderer)
        core = RenderCameraCore(
            renderer, MakeCameraInfo(CAMERA), ClippingRange(0.01, 10.0), RigidTransform()
        )
        sensor = RgbdSensor(
            parent_id=self.scene_graph.world_frame_id(),
            X_PB=X_WC,
            color_camera=ColorRenderCamera(core, False),
            depth_camera=DepthRenderCamera(core, DepthRange(0.1, 5.0)),
        )
        self.sensor = builder.AddSystem(sensor)
        builder.Connect(self.scene_graph.get_query_output_port(), sensor.query_object_input_port())
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def image(self, time):
        self.context.SetTime(time)
        context = self.sensor.GetMyContextFromRoot(self.context)
        return self.sensor.color_image_output_port().Eval(context).data[:, :, :3].copy()

    def positions(self, time, mover=0):
        """p_TG of a mover's things, shape (n, 3)."""
        self.context.SetTime(time)
        system = self.movers[mover]
        poses = system.get_output_port().Eval(system.GetMyContextFromRoot(self.context))
        X_TW = (X_WC @ X_CT).inverse()
        frames = sorted(poses.ids(), key=self.scene_graph.model_inspector().GetName)
        X_TGs = [X_TW @ poses.value(frame) for frame in frames]
        for X_TG in X_TGs:
            np.testing.assert_allclose(X_TG.rotation().matrix(), np.eye(3), atol=1e-12)
        return np.array([X_TG.translation() for X_TG in X_TGs])


def pixels(image, color):
    """Where an image has a color's hue: (u, v), shape (n, 2)."""
    levels = image.astype(int)
    k = int(np.argmax(color))
    others = np.delete(levels, k, axis=2).max(axis=2)
    v, u = np.nonzero(levels[:, :, k] > others + 60)
    return np.column_stack([u, v])


@parameters
class Setup:
    clutter: tuple[Clutter, ...] = ()


@pytest.mark.parametrize("cls", [Occluder, Distractors])
def test_each_is_read_from_its_name_and_written_again(cls):
    name = cls.__name__.lower()
    assert read_parameters(Setup, {"clutter": [name]}) == Setup(clutter=(cls(),))
    changed = Setup(clutter=(cls(center=[0.1, 0.2, 0.3]),))
    assert read_parameters(Setup, plain(changed)) == changed


# The occluder.


def test_an_occluder_swings_on_its_line():
    plate = Occluder(center=[0.1, 0.0, -0.2], direction=[0.0, 3.0, 4.0], amplitude=0.5, period=8.0)
    scene = Scene(plate)
    for time, place in ((0.0, 0.0), (2.0, 0.5), (4.0, 0.0), (6.0, -0.5), (7.0, -0.5 / 2**0.5)):
        expected = [[0.1, 0.6 * place, -0.2 + 0.8 * place]]
        np.testing.assert_allclose(scene.positions(time), expected, atol=1e-12)


def test_an_occluder_passes_once_at_constant_speed():
    scene = Scene(Occluder(start=1.0, duration=2.0, amplitude=0.4))
    for time, x in ((0.0, -0.4), (1.0, -0.4), (1.5, -0.2), (2.0, 0.0), (3.0, 0.4), (9.0, 0.4)):
        np.testing.assert_allclose(scene.positions(time), [[x, 0.0, -0.3]], atol=1e-12)


@pytest.mark.parametrize("renderer", ["flat", "vtk"])
def test_an_occluder_hides_what_is_behind_it_and_has_no_hue(renderer):
    size, amplitude = 0.04, 0.15
    plate = Occluder(size=[size, 0.3, 0.002], amplitude=amplitude, period=4.0, grey=0.2)
    scene = Scene(plate, renderer=renderer)
    whole = len(pixels(scene.image(1.0), RED))  # The plate is at its amplitude, beside the cube.
    assert whole == pytest.approx((0.1 * CAMERA.fx / 0.75) ** 2, rel=0.06)
    hidden = scene.image(0.0)  # in the middle, 0.5 m away
    width = size * CAMERA.fx / 0.5
    assert len(pixels(hidden, RED)) == pytest.approx(
        whole * (1.0 - width / (0.1 * CAMERA.fx / 0.75)), rel=0.1
    )
    # Dark grey, where its center projects
    dark = np.column_stack(np.nonzero((hidden.max(axis=2) < 100) & (hidden.min(axis=2) > 0)))
    chroma = hue_chroma_value(hidden[dark[:, 0], dark[:, 1]])[1]
    assert (chroma > 1e-9).mean() < 0.03  # where VTK blends it with the cube
    later = scene.image(0.5)
    _, u = np.nonzero((later.max(axis=2) < 100) & (np.ptp(later, axis=2) == 0))
    x = amplitude * np.sin(np.pi / 4.0)
    assert u.mean() == pytest.approx(CAMERA.project([x, 0.0, 0.5])[0], abs=1.0)
    assert np.ptp(u) + 1 == pytest.approx(width, abs=2.0)


# Distractors.


def test_distractors_stay_in_their_region_and_move_smoothly():
    region, center = np.array([0.6, 0.4, 0.2]), np.array([0.1, 0.0, 0.3])
    things = Distractors(number=9, center=center, region=region, period=3.0)
    scene = Scene(things)
    step = 0.05
    paths = np.array([scene.positions(step * k) for k in range(600)])
    assert paths.shape == (600, 9, 3)
    assert (np.abs(paths - center) <= 0.5 * region * (1.0 + 1e-9)).all()
    # No faster than if all of the amplitude had the shortest period.
    rate = 2.0 * np.pi * 1.5 / 3.0
    assert (np.abs(np.diff(paths, axis=0)) <= 0.5 * region * rate * step).all()
    assert (np.ptp(paths, axis=0) > 0.4 * region).all()
    paths = paths - paths.mean(axis=0)
    first, second = paths[:, 0, 0], paths[:, 1, 0]
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.9


def test_paths_depend_on_seed_and_index_alone():
    first = Scene(Distractors(number=4)).positions(2.0)
    np.testing.assert_array_equal(Scene(Distractors(number=4)).positions(2.0), first)
    assert np.abs(Scene(Distractors(number=4), seed=2).positions(2.0) - first).min() > 0.0
    both = Scene(Distractors(number=4), Distractors(number=4))
    np.testing.assert_array_equal(both.positions(2.0, mover=0), first)
    assert np.abs(both.positions(2.0, mover=1) - first).min() > 0.0


def test_things_move_alike_in_two_scenes_of_one_diagram():
    builder = DiagramBuilder()
    ports = []
    for name in ("shown", "drawn"):
        scene_graph = builder.AddNamedSystem(name, SceneGraph())
        mover = Distractors(number=2).AddToScene(
            builder, scene_graph, X_WT=RigidTransform(), colors=[RED], index=0, seed=0
        )
        ports.append(mover.get_output_port())
    context = builder.Build().CreateDefaultContext()
    context.SetTime(1.5)
    poses = [port.Eval(port.get_system().GetMyContextFromRoot(context)) for port in ports]
    first, second = ([p.value(frame).translation() for frame in p.ids()] for p in poses)
    np.testing.assert_array_equal(sorted(map(tuple, first)), sorted(map(tuple, second)))


@pytest.mark.parametrize("renderer", ["flat", "vtk"])
def test_distractors_are_drawn_in_the_targets_colors_where_they_are(renderer):
    size = 0.03
    things = Distractors(number=6, size=size, center=[0.0, 0.0, 0.2], region=[0.7, 0.5, 0.1])
    scene = Scene(things, renderer=renderer)
    empty = Scene(renderer=renderer)
    compared = 0
    for time in (0.0, 1.0, 2.5):
        image, positions = scene.image(time), scene.positions(time)
        for color in (GREEN, BLUE):
            # Two of each color, a sphere and a cube: their outlines' areas, and no more
            k = [2, 3] if color is GREEN else [4, 5]
            places = CAMERA.project(positions[k] + X_CT.translation())
            found = pixels(image, color).astype(float)
            distances = np.linalg.norm(found[:, None] - places, axis=2)
            depth = positions[k, 2].min() + X_CT.translation()[2]
            assert distances.min(axis=1).max() < 0.5 * np.sqrt(3.0) * size * CAMERA.fx / depth + 1
            compared += len(found)
        red = pixels(image, RED)
        assert len(red) >= 0.8 * len(pixels(empty.image(time), RED))
    assert compared > 6 * 40


def test_the_things_are_seen_by_cameras_and_meshcat_and_touch_nothing():
    scene = Scene(Distractors(number=3), Occluder())
    inspector = scene.scene_graph.model_inspector()
    assert inspector.NumGeometriesWithRole(Role.kPerception) == 1 + 4
    assert inspector.NumGeometriesWithRole(Role.kIllustration) == 4
    assert inspector.NumGeometriesWithRole(Role.kProximity) == 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Occluder(size=[0.1, 0.0, 0.1]), "Occluder: size must be three positive numbers, "),
        (lambda: Occluder(direction=[0, 0, 0]), "Occluder: direction must be a vector other than"),
        (lambda: Occluder(grey=2.0), "Occluder: grey must be at most 1, not 2.0"),
        (lambda: Distractors(number=0), "Distractors: number must be at least 1, not 0"),
        (lambda: Distractors(region=[1, 1, -1]), "Distractors: region must be three numbers from"),
        (lambda: Distractors(center=[1, 1]), r"Distractors: center must be a list of 3 values"),
    ],
)
def test_wrong_parameters_are_named(make, message):
    with pytest.raises(ParameterError, match=message):
        make()
