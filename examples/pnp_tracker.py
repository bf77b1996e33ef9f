"""Another pose estimator in the recognizer's place: face corners and OpenCV's solvePnP.

    python examples/pnp_tracker.py

It tracks the box with one camera, along the paper's path and with a hand that shakes, with and
without motion feedforward (MFF), prints the errors and draws what the shaking camera sees at last
into pnp_tracker.png. On two cores that takes half a minute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

import mffdrake as mff

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_THINNEST = 8.0  # [px] A face seen so much from the side that it looks thinner has no good corners.
_LEAST_AREA = 50.0  # of a face's region [px^2]
_NEAR_SIDE = 5.0  # [px] from where a side should be
_OFF_CORNERS = 0.1  # of a side's length at either end, which the fit leaves out
_LEAST_PIXELS = 6  # along a side


@dataclass(frozen=True, kw_only=True)
class PnpTracker:
    """Finds the corners of the visible faces near the carried pose, and solves for the pose.

    In every frame it looks for each visible face's color around where the target should lie, fits a
    line to each side of the face's region, intersects the lines to sub-pixel corners, and gives all
    corners to ``cv2.solvePnP``, with the carried pose as the guess. It has one hypothesis and no
    state: the pose comes from the last `mffdrake.Generation`.

    Attributes:
        rig: The cameras, of which it looks through the first one. That has no distortion.
        solid: The target; faces that are seen together have different colors.
        initial_pose: Where the target is about at the first frame: pose vector, shape (6,).
        search_radius: How far the target may lie from where it should [px].
        most_error: Greatest distance of a good corner from where the solved pose has it [px].

    Raises:
        ValueError: When the first camera has a distortion.

    Example:
        >>> box = mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj")
        >>> pose = np.array([0.0, 0.155, 0.8, 0.0, 0.0, 0.0])
        >>> tracker = PnpTracker(rig=mff.CameraRig.stereo(), solid=box, initial_pose=pose)
        >>> grey = np.full((480, 640, 3), 128, dtype=np.uint8)
        >>> tracker.start_population([grey, grey], frame=0).fitness   # nothing to be found
        array([0.])
    """

    rig: mff.CameraRig
    solid: mff.SolidModel
    initial_pose: Array
    search_radius: float = 15.0
    most_error: float = 1.5

    def __post_init__(self) -> None:
        """Checks the lens: straight edges must be straight in the image."""
        camera = self.rig.cameras[0]
        if camera.distortion.model != "none":
            raise ValueError(
                f"camera '{camera.name}': distortion must be of model none, not "
                f"{camera.distortion.model}; undistort the images first"
            )

    @property
    def num_hypotheses(self) -> int:
        """One."""
        return 1

    @cached_property
    def colors(self) -> mff.ColorModel:
        """How the faces look: hues as in the mesh file."""
        hues = dict(zip(self.solid.materials, self.solid.hues, strict=True))
        return mff.ColorModel.of_hues(hues, tolerance=math.radians(30.0))

    def start_population(self, images: Sequence[Image], *, frame: int) -> mff.Generation:
        """Takes the first frame as any other, from the initial pose."""
        start = mff.Generation(self.initial_pose[None], np.zeros(1))
        return self.track(start, images, frame=frame)

    def track(
        self, generation: mff.Generation, images: Sequence[Image], *, frame: int
    ) -> mff.Generation:
        """Takes a frame: the pose and, as its fitness, the share of corners that agree with it."""
        carried = generation.best
        shown, origin = self._classify_near(carried, images[0])
        sought: list[Array] = []
        found: list[Array] = []
        for face in self._visible_faces(carried):
            corners = self.solid.vertices[list(self.solid.faces[face])]
            expected = self._project(corners, carried)
            longest = np.linalg.norm(expected - np.roll(expected, 1, axis=0), axis=1).max()
            if _area(expected) > _THINNEST * longest:
                bit = self.colors.bits_of([self.solid.materials[face]])[0]
                sought += list(corners)
                found += list(_find_corners(shown & bit > 0, expected - origin) + origin)
        pose, agreeing = self._solve(np.array(sought), np.array(found), carried)
        if agreeing < 0.5:  # Nothing to rely on: the carried pose bridges the gap.
            return mff.Generation(carried[None], np.zeros(1))
        return mff.Generation(pose[None], np.array([agreeing]))

    def _visible_faces(self, pose: Array) -> NDArray[np.int64]:
        """The faces that the camera sees the front of, by number."""
        R_CM, p_CM = mff.transform_from_pose(pose)
        p_MK = R_CM.T @ (self.rig.cameras[0].p_CK - p_CM)
        toward = np.einsum("fk,fk->f", self.solid.normals, p_MK - self.solid.centers)
        return np.flatnonzero(toward > 0.0)

    def _project(self, p_M: Array, pose: Array) -> Array:
        """Pixels of points of the solid, shape (N, 2)."""
        R_CM, p_CM = mff.transform_from_pose(pose)
        return self.rig.cameras[0].project(p_M @ R_CM.T + p_CM)

    def _classify_near(self, pose: Array, image: Image) -> tuple[NDArray[np.uint32], Array]:
        """The colors shown around where the target should lie, and that part's first pixel."""
        pixels = np.nan_to_num(self._project(self.solid.vertices, pose))  # NaN: behind the camera
        size = image.shape[1::-1]
        low = np.clip(pixels.min(axis=0) - self.search_radius, 0, size).astype(int)
        high = np.clip(pixels.max(axis=0) + self.search_radius, 0, size).astype(int)
        part = image[low[1] : high[1], low[0] : high[0]]
        return self.colors.classify(part), low.astype(float)

    def _solve(self, p_MV: Array, pixels: Array, guess: Array) -> tuple[Array, float]:
        """The pose vector from corners of the solid [m] and in the image [px].

        Returns:
            The pose vector, and the share of the corners that agree with it.
        """
        if len(pixels) == 0:
            return guess, 0.0
        camera = self.rig.cameras[0]
        K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
        R_CM, p_CM = mff.transform_from_pose(guess)
        rotation, _ = cv2.Rodrigues(camera.R_CK.T @ R_CM)
        p_KM = camera.R_CK.T @ (p_CM - camera.p_CK)
        good = np.isfinite(pixels).all(axis=1)
        pose = guess
        for _ in range(2):  # at first with all corners, then with those that agree
            if good.sum() < 4:
                return guess, 0.0
            _, rotation, p_KM = cv2.solvePnP(
                p_MV[good], pixels[good], K, None, rotation, p_KM, useExtrinsicGuess=True
            )
            R_CM = camera.R_CK @ cv2.Rodrigues(rotation)[0]
            pose = mff.pose_from_transform(R_CM, camera.R_CK @ p_KM.ravel() + camera.p_CK)
            error = np.linalg.norm(self._project(p_MV, pose) - pixels, axis=1)
            good = error < self.most_error  # NaN, a corner not found, is not
        return pose, float(good.mean())


def _area(polygon: Array) -> float:
    """A polygon's area [px^2]."""
    return float(cv2.contourArea(polygon.astype(np.float32)))


def _middle(polygon: Array) -> Array:
    """The middle of a polygon's area, shape (2,)."""
    m = cv2.moments(polygon.astype(np.float32))
    return np.array([m["m10"], m["m01"]]) / m["m00"]


def _find_corners(mask: NDArray[np.bool_], expected: Array) -> Array:
    """Corners of the largest region in a mask, between lines fitted to its contour.

    Args:
        mask: Which pixels show a face's color, shape (height, width).
        expected: The face's corners where they should be, in order [px], shape (K, 2).

    Returns:
        The corners [px], shape (K, 2); NaN beside a side that is not to be seen.
    """
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max((c[:, 0].astype(float) for c in contours), key=_area, default=np.zeros((1, 2)))
    if _area(contour) < _LEAST_AREA:
        return np.full_like(expected, np.nan)
    # Moved onto the region, the expected sides are near the real ones.
    starts = expected + _middle(contour) - _middle(expected)
    sides = np.roll(starts, -1, axis=0) - starts
    lengths = np.linalg.norm(sides, axis=1)
    x, y = (sides / lengths[:, None]).T
    du, dv = np.moveaxis(contour[:, None] - starts, -1, 0)
    along, across = (du * x + dv * y) / lengths, np.abs(dv * x - du * y)  # shape (N, K)
    nearest = across == across.min(axis=1, keepdims=True)
    on_side = nearest & (across < _NEAR_SIDE) & (abs(along - 0.5) < 0.5 - _OFF_CORNERS)
    lines = [_fit_line(contour[pixels], starts.mean(axis=0)) for pixels in on_side.T]
    meets = np.cross(np.roll(lines, 1, axis=0), lines)  # homogeneous: where two lines meet
    with np.errstate(divide="ignore", invalid="ignore"):  # Parallel ones meet nowhere.
        return meets[:, :2] / meets[:, 2:]


def _fit_line(pixels: Array, inside: Array) -> Array:
    """The line ``(n, c)``, ``n p + c = 0``, along a region's outermost pixels, shape (3,)."""
    if len(pixels) < _LEAST_PIXELS:
        return np.full(3, np.nan)
    x, y, u, v = cv2.fitLine(pixels.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
    n = np.array([-y, x])
    if n @ (inside - (u, v)) > 0.0:
        n = -n  # outward
    # The outermost pixels' centers lie half a pixel inside, along u or v, on average.
    return np.append(n, -n @ (u, v) - 0.5 * abs(n).max())


def MakeDiagram(
    path: mff.HandPath, gains: mff.PdGains, *, duration: float, feedforward: bool
) -> Diagram:
    """The hand-eye system with the `PnpTracker` in the recognizer's place, with or without MFF.

    The box stands 0.8 m in front of the hand's first pose.
    """
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.001, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(config, builder)
    mff.AddPa10(plant)
    mff.AddCameraFrames(plant)
    parser = Parser(plant)
    mff.ConfigureParser(parser)
    parser.AddModelsFromUrl("package://mffdrake/target_box.sdf")
    X_WM = path.X_WE0 @ RigidTransform([0.0, 0.0, 0.8])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("target_box"), X_WM)
    plant.Finalize()

    arm = mff.MakePa10Plant()  # the controller's and the predictor's model of the arm
    joints = mff.SolveHandPath(arm, path, duration=duration)
    plant.SetDefaultPositions(joints.value(0.0).ravel())
    source = mff.AddHandPathSource(builder, joints)
    controller = builder.AddSystem(mff.PdController(kp=gains.kp, kd=gains.kd))
    state = plant.get_state_output_port()
    builder.Connect(source.get_output_port(), controller.GetInputPort("desired_state"))
    builder.Connect(state, controller.GetInputPort("estimated_state"))
    builder.Connect(controller.GetOutputPort("actuation"), plant.get_actuation_input_port())
    torque = controller.GetInputPort("feedforward_torque")
    mff.AddGravityCompensation(
        builder, arm_plant=arm, estimated_state=state, feedforward_torque=torque
    )

    rig = mff.CameraRig(mff.CameraRig.stereo().cameras[:1])  # the right camera alone
    renderer = mff.AddRenderer(scene_graph, "flat")
    camera = mff.AddStereoCamera(
        builder, plant=plant, scene_graph=scene_graph, rig=rig, renderer=renderer
    )
    tracker = PnpTracker(
        rig=rig,
        solid=mff.SolidModel.from_mesh_file(mff.FindModelsPath() / "target_box.obj"),
        initial_pose=CalcTruePose(plant, plant.CreateDefaultContext()),
    )
    recognizer = builder.AddNamedSystem("recognizer", mff.PoseRecognizer(tracker=tracker))
    image = "color_image_right"
    builder.Connect(camera.GetOutputPort(image), recognizer.GetInputPort(image))
    if feedforward:
        predictor = builder.AddSystem(mff.MffPredictor(plant=arm, num_hypotheses=1))
        mff.ConnectFeedforward(
            builder, recognizer=recognizer, predictor=predictor, estimated_state=state
        )
    return builder.Build()


def CalcTruePose(plant: MultibodyPlant, context: Context) -> Array:
    """The box's true pose vector in the right camera, shape (6,)."""
    C, M = plant.GetFrameByName("camera_right"), plant.GetFrameByName("target_box")
    X_CM = plant.CalcRelativeTransform(context, C, M)
    return mff.pose_from_transform(X_CM.rotation().matrix(), X_CM.translation())


def Track(diagram: Diagram, duration: float) -> tuple[Array, Array, Image]:
    """Simulates a diagram until a time [s].

    Returns:
        True and recognized pose vector of every frame, shape (K, 2, 6); the latter's fitness, shape
        (K,); and the last frame's image with the recognized outline.
    """
    recognizer = diagram.GetSubsystemByName("recognizer")
    plant = diagram.GetSubsystemByName("plant")
    simulator = Simulator(diagram)
    context = recognizer.GetMyContextFromRoot(simulator.get_context())
    plant_context = plant.GetMyContextFromRoot(simulator.get_context())
    image_port = recognizer.GetInputPort("color_image_right")
    poses, fitness = [], []
    for frame in range(recognizer.timing.NumFrames(duration)):
        # A frame is taken as the simulation leaves its time: until then the state is what it shows.
        simulator.AdvanceTo(recognizer.timing.TimeOfFrame(frame))
        true_pose = CalcTruePose(plant, plant_context)
        image = image_port.Eval(context).data.copy()
        simulator.AdvanceTo(simulator.get_context().get_time() + recognizer.timing.control_period)
        poses.append([true_pose, recognizer.GetOutputPort("pose").Eval(context)])
        fitness.append(recognizer.GetOutputPort("fitness").Eval(context)[0])
    tracker = recognizer.tracker
    view = mff.DrawOutline(image, poses[-1][1], tracker.solid, tracker.rig.cameras[0])
    return np.array(poses), np.array(fitness), view


def main(duration: float = 10.0) -> None:
    """Prints the table and writes the picture."""
    askew = RigidTransform(RollPitchYaw(np.radians([-90.0, 45.0, -90.0])), [0.9, 0.0, 0.455])
    shaking = mff.HandPath(amplitude=math.radians(7.5), distance=0.573, omega=7.54, X_WE0=askew)
    motions = {
        "paper's path, 0.314 rad/s": (mff.HandPath(omega=0.314), mff.PdGains.LightlyDamped()),
        "shaking hand, 7.54 rad/s": (shaking, mff.PdGains.WellDamped()),
    }
    rows = [("motion", "MFF", "rms [mm]", "worst [mm]", "nothing found")]
    for name, (path, gains) in motions.items():
        for feedforward in (True, False):
            diagram = MakeDiagram(path, gains, duration=duration, feedforward=feedforward)
            poses, fitness, view = Track(diagram, duration)
            if feedforward:
                mff.SaveImage(view, Path("pnp_tracker.png"))
            error = 1e3 * np.linalg.norm(poses[:, 1, :3] - poses[:, 0, :3], axis=1)
            rms, lost = np.sqrt(np.mean(error**2)), np.mean(fitness == 0.0)
            answer = "yes" if feedforward else "no"
            rows.append((name, answer, f"{rms:.2f}", f"{error.max():.1f}", f"{lost:.1%}"))
    table = (f"{a:26} {b:4} {c:>9} {d:>11} {e:>14}" for a, b, c, d, e in rows)
    print("\n".join(table))


if __name__ == "__main__":
    main()
