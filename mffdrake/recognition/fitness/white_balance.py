"""Follows slow changes of the light's color while a target is tracked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.fitness.colors import around_circle, hue_chroma_value
from mffdrake.recognition.fitness.matching import Gains, Matcher
from mffdrake.recognition.parameters import Positive, check_fields
from mffdrake.recognition.poses.pose import transform_from_pose

if TYPE_CHECKING:
    from mffdrake.recognition.fitness.structs import Scene

Array = NDArray[np.float64]

_LEAST_PIXELS = 10  # of a color, for it to count
_STEP = 1e-3  # of a gain's logarithm, for the derivative
_DAMPING = math.radians(2.0) ** 2  # Gains that hardly change any hue stay as they are.


class WhiteBalance(Protocol):
    """Changes the gains of the color channels from frame to frame.

    Example:
        >>> class Dusk:  # The light gets redder, slowly.
        ...     def adapt(self, gains, pose, scene, matcher):
        ...         return 0.999 * gains[0], 1.0, gains[2]
        >>> balance: WhiteBalance = Dusk()  # A `OneStepGaTracker` takes it.
    """

    def adapt(self, gains: Gains, pose: ArrayLike, scene: Scene, matcher: Matcher) -> Gains:
        """The next frame's gains."""
        ...


@dataclass(frozen=True)
class FixedWhiteBalance:
    """Leaves the gains as they are.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, OneStepGaTracker
        >>> from mffdrake.recognition import SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> OneStepGaTracker(matcher=matcher).white_balance
        FixedWhiteBalance()
    """

    def adapt(self, gains: Gains, pose: ArrayLike, scene: Scene, matcher: Matcher) -> Gains:
        """The given gains."""
        return gains


@dataclass(frozen=True)
class AdaptiveWhiteBalance:
    """Follows the light by what the faces of a surely tracked solid look like.

    The pixels under a face should have its color's mean hue. The gains of red and blue (green's
    stays 1) move towards those that make them so, all colors in one least-squares step. Pixels that
    lie outside a color's tolerance by more than as much again do not count, so the light may change
    slowly only.

    Attributes:
        rate: Greatest relative change of a gain a frame, above 0.

    Raises:
        ValueError: When the rate is not positive.

    Example:
        >>> AdaptiveWhiteBalance(0.005).rate
        0.005
    """

    rate: Positive = 0.005

    def __post_init__(self) -> None:
        """Checks the rate."""
        check_fields(self, "white balance: ")

    def adapt(self, gains: Gains, pose: ArrayLike, scene: Scene, matcher: Matcher) -> Gains:
        """The next frame's gains.

        Args:
            gains: This frame's gains of red, green and blue.
            pose: Where the solid surely is, pose vector of shape (6,).
            scene: The images, see `Matcher.scene`.
            matcher: The solid, its colors and the cameras.

        Returns:
            Gains, no farther from the given ones than the rate allows.
        """
        means, wanted = [], []
        for color, pixels in zip(
            matcher.colors.colors, _pixels_of_colors(pose, scene, matcher), strict=True
        ):
            hue, chroma, value = hue_chroma_value(np.minimum(pixels * gains, 255.0))
            near = np.abs(around_circle(hue - color.hue)) <= 2.0 * color.tolerance
            counts = near & (chroma >= matcher.colors.min_chroma) & (value < 0.99) & (chroma > 0.0)
            if counts.sum() >= _LEAST_PIXELS:
                means.append(pixels[counts].mean(axis=0))
                wanted.append(color.hue)
        if not means:
            return gains
        colors, hues = np.array(means), np.array(wanted)

        def off(logs: Array) -> Array:
            scaled = colors * np.exp([logs[0], 0.0, logs[1]])
            return around_circle(hue_chroma_value(scaled)[0] - hues)

        logs = np.log([gains[0], gains[2]])
        J = np.column_stack(
            [(off(logs + step) - off(logs - step)) / (2.0 * _STEP) for step in _STEP * np.eye(2)]
        )
        move = -np.linalg.solve(J.T @ J + _DAMPING * np.eye(2), J.T @ off(logs))
        logs += np.clip(move, -self.rate, self.rate)
        red, blue = np.exp(logs).tolist()
        return red, 1.0, blue


def _pixels_of_colors(pose: ArrayLike, scene: Scene, matcher: Matcher) -> list[Array]:
    """RGB values of the pixels under the inside points of each color's faces, each (n, 3)."""
    R, p = transform_from_pose(pose)
    model, solid = matcher.search_model, matcher.solid
    found: dict[str, list[Array]] = {name: [] for name in matcher.colors.names}
    for camera, view in zip(matcher.rig.cameras, scene.views, strict=True):
        image = view.pixels.reshape(camera.height, camera.width, -1)
        p_MK = R.T @ (camera.p_CK - p)
        pixels = np.floor(camera.project(model.inside_points @ R.T + p) + 0.5)
        for k, material in enumerate(solid.materials):
            if solid.normals[k] @ (p_MK - solid.centers[k]) <= 0.0:
                continue
            u, v = pixels[model.inside_start[k] : model.inside_start[k + 1]].T
            seen = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)  # no NaN
            colors = image[v[seen].astype(int), u[seen].astype(int), :3].astype(float)
            found[material].append(colors if matcher.channel_order == "rgb" else colors[:, ::-1])
    return [np.concatenate([*parts, np.empty((0, 3))]) for parts in found.values()]
