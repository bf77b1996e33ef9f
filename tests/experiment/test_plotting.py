"""Pictures: the panels with their units and data, the files, and an outline that fits the image."""

import dataclasses as dc
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from mffdrake.experiment.runs.pictures import PlotComparison, PlotErrors
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.evaluation import Evaluate
from mffdrake.experiment.simulation.pictures import DescribeFrame, DrawCameraView, DrawScene
from mffdrake.experiment.simulation.plotting import PlotHandPath, PlotPose, SaveFigure
from mffdrake.experiment.simulation.simulation import Simulate, SimulationResult
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.experiment.simulation.wiring.target import CalcDesiredPose
from mffdrake.recognition import CameraRig, Distortion
from mffdrake.recognition.recordings.image_files import SaveImage
from mffdrake.recognition.visibility.outline import DrawOutline, DrawViews
from mffdrake.systems.rendering.visualization import SaveDiagram

COORDINATES = ["x [mm]", "y [mm]", "z [mm]", "eps1", "eps2", "eps3"]
TIME = 0.033 * np.arange(300)


def make_result(method="mff", omega=0.105, seed=0, time=TIME):
    """A record with an oscillation of its own in every coordinate."""
    rng = np.random.default_rng(seed)
    waves = 0.05 * np.sin(time[:, None] * np.arange(1.0, 7.0))
    text = f"{{method: {method}, seed: {seed}, hand_path: {{omega: {omega}}}}}"
    return SimulationResult(
        scenario=LoadScenario(text=text).Dump(),
        time=time,
        true_pose=[0, 0.155, 0.8, 0, 0, 0] + waves,
        recognized_pose=[0, 0.155, 0.8, 0, 0, 0] + waves + 0.01 * rng.random(waves.shape),
        fitness=rng.random(len(time)),
        state=np.ones(len(time)),
        confidence=rng.random(len(time)),
        is_tracking=np.ones(len(time)),
        desired_hand_pose=waves,
        actual_hand_pose=waves + 0.001 * rng.random(waves.shape),
        joint_positions=np.zeros((len(time), 7)),
        joint_velocities=np.zeros((len(time), 7)),
        stages_ms={"render": 8.0, "recognition": 2.0, "prediction": 0.5, "total": 12.0},
        wall_s=4.0,
    )


def curves(axis):
    """What is drawn, by label."""
    return {line.get_label(): line for line in axis.get_lines()}


def labels_of(axes):
    return [axis.get_ylabel() for axis in axes]


# Figures.


def test_the_hand_path_has_six_panels_over_time():
    result = make_result()
    figure = PlotHandPath(result)
    assert labels_of(figure.axes) == COORDINATES
    assert [axis.get_xlabel() for axis in figure.axes] == 3 * [""] + 3 * ["time [s]"]
    assert "0.105 rad/s" in figure.get_suptitle()
    for k, axis in enumerate(figure.axes):
        lines = curves(axis)
        unit = 1e3 if k < 3 else 1.0
        for name, pose in (
            ("actual", result.actual_hand_pose),
            ("desired", result.desired_hand_pose),
        ):
            np.testing.assert_array_equal(lines[name].get_xdata(), result.time)
            np.testing.assert_array_equal(lines[name].get_ydata(), unit * pose[:, k])
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == [
        "actual", "desired",
    ]  # fmt: skip


def test_a_hand_that_stays_is_not_magnified_to_noise():
    result = make_result()
    result.actual_hand_pose[:] = 1e-9 * np.random.default_rng(0).random((len(TIME), 6))
    result.desired_hand_pose[:] = 0.0
    for k, axis in enumerate(PlotHandPath(result).axes):
        low, high = axis.get_ylim()
        assert high - low >= (1.0 if k < 3 else 0.001)  # mm, or a quaternion's component


def test_the_pose_has_seven_panels_with_both_methods_and_the_truth():
    results = [make_result("ga", seed=1), make_result("mff", seed=1)]
    figure = PlotPose(results)
    assert labels_of(figure.axes) == [*COORDINATES, "fitness"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert "0.105 rad/s" in figure.get_suptitle() and "seed 1" in figure.get_suptitle()
    for k, axis in enumerate(figure.axes[:6]):
        lines = curves(axis)
        unit = 1e3 if k < 3 else 1.0
        true = unit * results[0].true_pose[:, k]
        np.testing.assert_array_equal(lines["true"].get_ydata(), true)
        for name, result in zip(("1-step GA", "MFF + 1-step GA"), results, strict=True):
            drawn = lines[name].get_ydata()
            np.testing.assert_array_equal(drawn, unit * result.recognized_pose[:, k])
        low, high = axis.get_ylim()
        assert low < true.min() and true.max() < high
    fitness = [line.get_ydata() for line in figure.axes[6].get_lines()]
    for drawn, result in zip(fitness, results, strict=True):
        np.testing.assert_array_equal(drawn, result.fitness)
    low, high = figure.axes[6].get_ylim()
    assert low <= 0.0 and high >= 1.0


def test_a_wild_guess_does_not_hide_the_rest():
    result = make_result()
    calm = [axis.get_ylim() for axis in PlotPose([result]).axes]
    result.recognized_pose[0] = 100.0
    figure = PlotPose([result])
    assert [axis.get_ylim() for axis in figure.axes] == calm
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "true", "MFF + 1-step GA", "beyond the panel",
    ]  # fmt: skip
    for axis in figure.axes[:6]:  # A mark on the border says where it is.
        mark = curves(axis)["beyond the panel"]
        assert (*mark.get_xdata(), *mark.get_ydata()) == (0.0, axis.get_ylim()[1])


def test_what_stays_in_the_panels_is_not_marked():
    for axis in PlotPose([make_result()]).axes:
        assert "beyond the panel" not in curves(axis)


def test_errors_have_a_panel_for_each_speed():
    results = [make_result(m, omega) for omega in (0.105, 0.314) for m in ("ga", "mff")]
    figure = PlotErrors(results)
    assert labels_of(figure.axes) == ["position error [mm]"] * 2
    assert [axis.get_title() for axis in figure.axes] == [
        "omega = 0.105 rad/s", "omega = 0.314 rad/s",
    ]  # fmt: skip
    assert figure.axes[-1].get_xlabel() == "time [s]"
    for axis, pair in zip(figure.axes, (results[:2], results[2:]), strict=True):
        assert axis.get_yscale() == "log"
        lines = curves(axis)
        legend = [text.get_text() for text in axis.get_legend().get_texts()]
        assert legend[-1] == "settled from here on"
        assert lines[legend[-1]].get_xdata()[0] == 5.0
        for name, result in zip(
            ("1-step GA, seed 0", "MFF + 1-step GA, seed 0"), pair, strict=True
        ):
            error = (result.recognized_pose - result.true_pose)[:, :3]
            expected = 1e3 * np.sqrt((error**2).sum(axis=1))
            np.testing.assert_allclose(lines[name].get_ydata(), expected, rtol=1e-12)


@pytest.mark.parametrize(("time", "window"), [(TIME, "after the first 5 s"), (TIME[:9], "all")])
def test_the_comparison_has_three_panels_over_the_speed(time, window):
    rows = [
        Evaluate(make_result(method, omega, seed, time))
        for omega in (0.314, 0.105) for method in ("ga", "mff") for seed in (0, 1, 2)
    ]  # fmt: skip
    figure = PlotComparison(rows)
    assert labels_of(figure.axes) == [
        "mean fitness", "position error (rms) [mm]", "rotation error (rms) [deg]",
    ]  # fmt: skip
    assert window in figure.get_suptitle()
    suffix = "_settled" if len(time) > 200 else ""
    for axis, key in zip(figure.axes, (None, "position_mm", "rotation_deg"), strict=True):
        assert axis.get_xlabel() == "omega [rad/s]"
        lines = curves(axis)
        for name, method in (("1-step GA", "ga"), ("MFF + 1-step GA", "mff")):
            np.testing.assert_array_equal(lines[name].get_xdata(), [0.105, 0.314])
            for omega, drawn in zip((0.105, 0.314), lines[name].get_ydata(), strict=True):
                values = [
                    row[f"rms{suffix}"][key] if key else row[f"mean_fitness{suffix}"]
                    for row in rows
                    if (row["method"], row["omega"]) == (method, omega)
                ]
                assert drawn == pytest.approx(sorted(values)[1])
        points = [line for line in axis.get_lines() if line.get_linestyle() == "None"]
        assert sum(len(line.get_xdata()) for line in points) == len(rows)


def test_figures_belong_to_no_window(tmp_path):
    """Nothing piles up in matplotlib's list of figures; pyplot is not even loaded."""
    code = (
        "import sys; from mffdrake.experiment.simulation.plotting import NewFigure, SaveFigure; "
        f"SaveFigure(NewFigure(1, 1, (2.0, 2.0))[0], {str(tmp_path / 'a.png')!r}); "
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "a.png").stat().st_size > 0


# Files.


def test_a_figure_is_saved_as_png_or_svg(tmp_path):
    figure = PlotPose([make_result()])
    SaveFigure(figure, tmp_path / "pose.png")
    SaveFigure(figure, str(tmp_path / "pose.svg"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pose.png", "pose.svg"]
    image = cv2.imread(str(tmp_path / "pose.png"))
    width, height = figure.get_size_inches() * 120
    assert image.shape == (round(height), round(width), 3)
    assert image.std() > 5.0  # There is something to see.
    root = ET.parse(tmp_path / "pose.svg").getroot()
    assert root.tag.endswith("}svg")


def test_a_figure_that_cannot_be_saved_leaves_nothing(tmp_path):
    figure = PlotHandPath(make_result())
    with pytest.raises(OSError):
        SaveFigure(figure, tmp_path / "missing" / "a.png")
    with pytest.raises(ValueError, match="svg"):  # matplotlib lists the formats it knows.
        SaveFigure(figure, tmp_path / "a.nonsense")
    assert list(tmp_path.iterdir()) == []


def test_an_image_is_saved_as_it_is(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    SaveImage(image, tmp_path / "a.png")
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png"))[:, :, ::-1], image)


# The outline, over rendered images in which faces differ in hue and the background is grey.

VIEWS = {
    "as in the paper": "[-90, 0, -90]",
    "three faces": "[-70, 25, -60]",
    "on its corner": "[-50, -30, -120]",
}


@pytest.fixture(scope="module", params=VIEWS)
def view(request):
    """The images of the target at rest, its true pose, and the recognizer's matcher."""
    text = f"target: {{X_WM: {{rotation: !Rpy {{deg: {VIEWS[request.param]}}}}}}}"
    scenario = LoadScenario(text="{duration: 0.1, camera: {width: 320, height: 240}, " + text + "}")
    diagram = MakeHandEyeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    images = tuple(
        diagram.GetOutputPort(f"stereo_camera.color_image_{side}").Eval(context).data.copy()
        for side in ("right", "left")
    )
    matcher = diagram.GetSubsystemByName("recognizer").tracker.matcher
    return images, CalcDesiredPose(scenario, 0.0), matcher


def color_borders(image):
    """Pixels with a neighbor of another color: the borders of the faces and of the silhouette."""
    hsv = cv2.cvtColor(image[:, :, :3], cv2.COLOR_RGB2HSV)
    color = np.where(hsv[:, :, 1] > 128, 1 + np.rint(hsv[:, :, 0] / 60.0) % 3, 0)
    border = np.zeros(color.shape, dtype=bool)
    beside, below = color[:, 1:] != color[:, :-1], color[1:] != color[:-1]
    for part, differs in (
        (border[:, 1:], beside), (border[:, :-1], beside), (border[1:], below), (border[:-1], below)
    ):  # fmt: skip
        part |= differs
    return border


def distance_to(mask):
    """Distance of every pixel from the nearest one in a mask [px]."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def largest_gaps(view, pose):
    """How far the outline gets from the colors' borders, and the other way round [px]."""
    images, _, matcher = view
    gaps = []
    for image, camera in zip(images, matcher.rig.cameras, strict=True):
        over = DrawOutline(image, pose, matcher.solid, camera)
        border = color_borders(image)
        outline = np.any(cv2.absdiff(over, image[:, :, :3].copy()) > 64, axis=2)
        gaps.append((distance_to(border)[outline].max(), distance_to(outline)[border].max()))
    return np.array(gaps)


def test_the_true_poses_outline_lies_on_the_borders_of_the_colors(view):
    gaps = largest_gaps(view, view[1])
    assert np.all(gaps[:, 0] <= 2.0)  # No part of the line, two pixels wide, is anywhere else,
    assert np.all(gaps[:, 1] <= 1.0)  # and no border is left out.


def test_another_poses_outline_does_not(view):
    for k, step in enumerate([0.01, 0.01, 0.05, 0.1, 0.1, 0.1]):
        pose = view[1].copy()
        pose[k] += step
        assert np.all(largest_gaps(view, pose)[:, 0] > 2.0)


def test_the_outline_is_white_and_black(view):
    images, pose, matcher = view
    for image, camera in zip(images, matcher.rig.cameras, strict=True):
        drawn = DrawOutline(image, pose, matcher.solid, camera)
        changed = drawn[np.any(drawn != image[:, :, :3], axis=2)]
        assert np.sum(changed.max(axis=1) < 60) > 100
        assert np.sum(changed.min(axis=1) > 100) > 100


def seen_by(lens, camera, image):
    """What another lens shows of what stands in a camera's image; grey where nothing does."""
    v, u = np.mgrid[: lens.height, : lens.width].astype(float)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    K = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    k, still = np.array(lens.distortion.coefficients), np.zeros(3)
    project = {"plumb_bob": cv2.projectPoints, "equidistant": cv2.fisheye.projectPoints}
    rays = (pixels - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
    for _ in range(60):  # Moves each ray by what its pixel lacks.
        points = np.column_stack([rays, np.ones(len(rays))])[:, None]
        found, _ = project[lens.distortion.model](points, still, still, K, k)
        rays += (pixels - found.reshape(-1, 2)) / [lens.fx, lens.fy]
    x, y = rays.reshape(*u.shape, 2).astype(np.float32).transpose(2, 0, 1)
    place = camera.fx * x + camera.cx, camera.fy * y + camera.cy
    grey = (128, 128, 128, 255)
    return cv2.remap(image, *place, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, grey)


@pytest.mark.parametrize(
    "distortion",
    [
        Distortion("plumb_bob", (-0.7, 0.15, 2e-3, -1e-3)),
        Distortion("equidistant", (-0.4, 0.05, 0.0, 0.0)),
    ],
    ids=lambda distortion: distortion.model,
)
def test_a_lens_bends_the_outline_as_it_bends_the_edges(view, distortion):
    """The image is distorted pixel by pixel, and the outline lies on its borders as before."""
    images, pose, matcher = view
    for image, camera in zip(images, matcher.rig.cameras, strict=True):
        bent = dc.replace(camera, distortion=distortion)
        seen = seen_by(bent, camera, image)
        border, gaps = color_borders(seen), {}
        for lens in (camera, bent):
            drawn = DrawOutline(seen, pose, matcher.solid, lens)
            outline = np.any(cv2.absdiff(drawn, seen[:, :, :3].copy()) > 64, axis=2)
            there, back = distance_to(border)[outline].max(), distance_to(outline)[border].max()
            gaps[lens.distortion.model] = (there, back)
        assert np.all(gaps[distortion.model] <= np.array([3.0, 2.0])), gaps
        assert max(gaps["none"]) > 4.0, gaps


def test_the_outline_changes_no_image_it_is_drawn_over(view):
    images, pose, matcher = view
    copies = [image.copy() for image in images]
    for given in (images, [image[:, :, :3].copy() for image in images]):
        before = [image.copy() for image in given]
        for image, camera in zip(given, matcher.rig.cameras, strict=True):
            drawn = DrawOutline(image, pose, matcher.solid, camera)
            assert (drawn.shape, drawn.dtype) == ((240, 320, 3), np.uint8)
        drawn = DrawViews(given, pose, matcher.solid, matcher.rig)
        assert (drawn.shape, drawn.dtype) == ((240, 640, 3), np.uint8)
        np.testing.assert_array_equal(given, before)
    np.testing.assert_array_equal(copies, images)


# All views of a rig, side by side.


def test_views_stand_by_where_their_cameras_look_from(view):
    """The left camera's on the left, with the outline and their cameras' names."""
    images, pose, matcher = view
    drawn = DrawViews(images, pose, matcher.solid, matcher.rig)
    for k, half in ((1, drawn[:, :320]), (0, drawn[:, 320:])):
        outlined = DrawOutline(images[k], pose, matcher.solid, matcher.rig.cameras[k])
        differs = np.any(half != outlined, axis=2)[:, 1:-1]  # without the line between them
        rows, columns = np.nonzero(differs)
        assert 50 < differs.sum() < 2000 and rows.max() < 30 and columns.max() < 100  # the name
    plain = DrawViews(images, None, matcher.solid, matcher.rig)
    np.testing.assert_array_equal(plain[30:, 321:], images[0][30:, 1:, :3])
    assert (plain[:, 319] == 0).all() and (plain[:, 320] == 255).all()


def test_views_of_another_number_and_of_different_heights(view):
    images, pose, matcher = view
    right, left = matcher.rig.cameras
    half = dc.replace(
        left, name="half", width=160, height=120, fx=0.5 * left.fx, fy=0.5 * left.fy,
        cx=0.5 * left.cx - 0.25, cy=0.5 * left.cy - 0.25, p_CK=left.p_CK + [0.05, 0.0, 0.0],
    )  # fmt: skip
    small = np.ascontiguousarray(images[1][::2, ::2])
    drawn = DrawViews((*images, small), pose, matcher.solid, CameraRig((right, left, half)))
    assert drawn.shape == (240, 320 + 160 + 320, 3)
    between = drawn[:, 321:479]
    assert not between[120:].any()
    assert between[:120].any()
    one = DrawViews(images[:1], pose, matcher.solid, CameraRig((right,)))
    np.testing.assert_array_equal(one[:, 1:], drawn[:, 481:])
    with pytest.raises(ValueError):
        DrawViews(images, pose, matcher.solid, CameraRig((right,)))


# Rendered pictures of a run.


@pytest.fixture(scope="module")
def run():
    text = "{duration: 0.3, camera: {width: 160, height: 120}, recognizer: {start: near_target}}"
    scenario = LoadScenario(text=text)
    diagram = MakeHandEyeDiagram(scenario)
    return diagram, scenario, Simulate(scenario, diagram=diagram)


def test_the_camera_view_shows_both_images_with_the_recognized_pose(run):
    diagram, scenario, result = run
    images = [DrawCameraView(diagram, scenario, result, frame) for frame in (0, -1)]
    for image in images:
        assert image.shape == (120, 320, 3)
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        colorful = (hsv[:, :, 1] > 128) & (hsv[:, :, 2] > 60)
        for half in np.split(colorful, 2, axis=1):
            assert 0.02 < half.mean() < 0.5
    assert np.any(images[0] != images[1])


def test_a_caption_stands_below_the_camera_view_and_hides_nothing_of_it(run):
    diagram, scenario, result = run
    plain = DrawCameraView(diagram, scenario, result)
    told = DrawCameraView(diagram, scenario, result, caption=True)
    assert told.shape == (128, 320, 3)
    np.testing.assert_array_equal(told[:120], plain)
    assert np.ptp(told[120:, :20]) > 200  # a piece of the outline, black and white
    assert np.ptp(told[120:, 125:]) > 50  # the numbers
    line = DescribeFrame(result, -1)
    assert line.startswith("t 0.30 s   fitness 0.") or line.startswith("t 0.30 s   fitness 1.")
    assert re.search(r"off \d+\.\d mm, \d+\.\d deg   (searching|tracking|\w+)$", line)


def test_the_scene_shows_the_arm_and_the_target(run):
    diagram, _, result = run
    image = DrawScene(diagram, result, width=240, height=180)
    assert image.shape == (180, 240, 3)
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    assert 0.001 < ((hsv[:, :, 1] > 128) & (hsv[:, :, 2] > 60)).mean() < 0.1  # the target
    background = np.all(image == image[0, 0], axis=2)
    assert 0.3 < background.mean() < 0.95


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_the_diagram_is_drawn_with_its_parts(run, tmp_path, suffix):
    SaveDiagram(run[0], tmp_path / f"diagram.{suffix}")
    if suffix == "png":
        image = cv2.imread(str(tmp_path / "diagram.png"))
        assert image.size > 100_000 and image.std() > 5.0
    else:
        text = " ".join(ET.parse(tmp_path / "diagram.svg").getroot().itertext())
        for part in ("recognizer", "predictor", "stereo_camera", "pd_controller", "hand_path"):
            assert re.search(rf"\b{part}\b", text)
    assert [path.name for path in tmp_path.iterdir()] == [f"diagram.{suffix}"]


def test_without_graphviz_the_error_has_the_command_that_helps(run, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OSError, match="apt-get install graphviz"):
        SaveDiagram(run[0], tmp_path / "diagram.svg")
    assert list(tmp_path.iterdir()) == []
