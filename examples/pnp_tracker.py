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


def MakeTracker(
    *, solid: mff.SolidModel, rig: mff.CameraRig, start_pose: Array, seed: int
) -> PnpTracker:
    """What `mffdrake.MakeHandEyeDiagram` takes; no random numbers, so no seed."""
    return PnpTracker(rig=rig, solid=solid, initial_pose=start_pose)


def Track(scenario: mff.Scenario) -> tuple[mff.SimulationResult, Image]:
    """Simulates a scenario with the `PnpTracker` in the recognizer's place.

    Returns:
        What happened, and the last frame's image with the recognized outline.
    """
    diagram = mff.MakeHandEyeDiagram(scenario, make_tracker=MakeTracker)
    result = mff.Simulate(scenario, diagram=diagram)
    return result, mff.DrawCameraView(diagram, scenario, result)


ONE_CAMERA = """
renderer: flat
cameras: [{name: right, X_PB: {translation: [0, -0.155, 0]}}]
"""
SHAKING_HAND = """
controller: {gains: well_damped}
hand_path:
  amplitude_deg: 7.5
  distance: 0.573
  omega: 7.54
  X_WE0: {translation: [0.9, 0, 0.455], rotation: !Rpy {deg: [-90, 45, -90]}}
target:
  X_WM: {translation: [1.7, 0, 0.455], rotation: !Rpy {deg: [-90, 45, -90]}}
"""
MOTIONS = {
    "paper's path, 0.314 rad/s": "hand_path: {omega: 0.314}",
    "shaking hand, 7.54 rad/s": SHAKING_HAND,
}


def main(duration: float = 10.0) -> None:
    """Prints the table and writes the picture."""
    rows = [("motion", "MFF", "rms [mm]", "worst [mm]", "nothing found")]
    for name, motion in MOTIONS.items():
        for method in ("mff", "ga"):
            scenario = mff.Change(
                mff.LoadScenario(text=ONE_CAMERA + motion), {"method": method, "duration": duration}
            )
            result, view = Track(scenario)
            if method == "mff":
                mff.SaveImage(view, Path("pnp_tracker.png"))
            error = 1e3 * np.linalg.norm((result.recognized_pose - result.true_pose)[:, :3], axis=1)
            rms, lost = np.sqrt(np.mean(error**2)), np.mean(result.fitness == 0.0)
            answer = "yes" if method == "mff" else "no"
            rows.append((name, answer, f"{rms:.2f}", f"{error.max():.1f}", f"{lost:.1%}"))
    table = (f"{a:26} {b:4} {c:>9} {d:>11} {e:>14}" for a, b, c, d, e in rows)
    print("\n".join(table))


if __name__ == "__main__":
    main()
