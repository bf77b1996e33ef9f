"""A solid's outline at a pose, drawn over cameras' images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.camera.cameras import Camera, CameraRig
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.solid.solid_model import SolidModel

__all__ = ["AddCaption", "DrawOutline", "DrawViews"]

Image = NDArray[np.uint8]

_PIECES = 16  # of an edge that the lens bends
_SUBPIXELS = 4  # bits of a drawn coordinate's fraction
_LEGEND = "outline of the recognized pose"


def DrawOutline(image: Image, pose: ArrayLike, solid: SolidModel, camera: Camera) -> Image:
    """An image with a solid's visible edges over it, bent as the lens bends them.

    Args:
        image: The camera's image, RGB or RGBA, shape (height, width, 3 or 4).
        pose: Pose vector of the solid in the rig's frame C, shape (6,).
        solid: The solid.
        camera: The camera.

    Returns:
        An RGB image, shape (height, width, 3).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> camera = CameraRig.stereo().cameras[0]
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> grey = np.full((480, 640, 3), 128, dtype=np.uint8)
        >>> drawn = DrawOutline(grey, [0.0, 0.155, 0.8, 0.0, 0.0, 0.0], box, camera)
        >>> bool(drawn.min() < 64 and drawn.max() > 192)    # a black line with white sides
        True
    """
    import cv2

    view = image[:, :, :3].copy(order="C")
    R_CM, p_CM = transform_from_pose(pose)
    p_MK = R_CM.T @ (camera.p_CK - p_CM)
    visible = np.einsum("fk,fk->f", solid.normals, p_MK - solid.centers) > 0.0
    pieces = 1 if camera.distortion.model == "none" else _PIECES
    shares = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    lines = []
    # Bends of a curved surface are to be seen where they are its silhouette alone.
    seen = visible[solid.edge_faces]
    drawn = seen.any(axis=1) & ~(solid.smooth & seen.all(axis=1))
    for (start, end), is_drawn in zip(solid.vertices[solid.edges], drawn, strict=True):
        if is_drawn:
            pixels = camera.project((start + shares * (end - start)) @ R_CM.T + p_CM)
            if np.isfinite(pixels).all():
                # What lies far outside is cut off: drawn coordinates must fit into 32 bits.
                scaled = np.clip(pixels, -1e8, 1e8) * 2**_SUBPIXELS
                lines.append(np.rint(scaled).astype(np.int32))
    for color, thickness in (((255, 255, 255), 2), ((0, 0, 0), 1)):
        cv2.polylines(view, lines, False, color, thickness, cv2.LINE_AA, shift=_SUBPIXELS)
    return view


def DrawViews(
    images: Sequence[Image], pose: ArrayLike | None, solid: SolidModel, rig: CameraRig
) -> Image:
    """All images of a rig side by side, with their cameras' names and a solid's outline.

    Args:
        images: One a camera, in the rig's order, RGB or RGBA, shape (height, width, 3 or 4).
        pose: Pose vector of the solid in the rig's frame C, shape (6,); None for no outline.
        solid: The solid.
        rig: The cameras.

    Returns:
        An RGB image, as high as the highest image; cameras stand by where they look from, those
        on the rig's left (at less x) first, with a line between them.

    Raises:
        ValueError: When there are more or fewer images than cameras.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> grey = np.full((480, 640, 3), 128, dtype=np.uint8)
        >>> DrawViews([grey, grey], None, box, CameraRig.stereo()).shape
        (480, 1280, 3)
    """
    import cv2

    views = []
    for camera, image in zip(rig.cameras, images, strict=True):
        view = image[:, :, :3].copy(order="C")
        if pose is not None:
            view = DrawOutline(image, pose, solid, camera)
        size = camera.height / 480.0
        corner, font = (round(16 * size), round(36 * size)), cv2.FONT_HERSHEY_SIMPLEX
        for color, thickness in (((255, 255, 255), 5), ((0, 0, 0), 2)):
            width = max(1, round(thickness * size))
            cv2.putText(view, camera.name, corner, font, 0.9 * size, color, width, cv2.LINE_AA)
        views.append(view)
    height = max(view.shape[0] for view in views)
    padded = [np.pad(v, ((0, height - v.shape[0]), (0, 0), (0, 0))) for v in views]
    order = np.argsort([camera.p_CK[0] for camera in rig.cameras], kind="stable")
    drawn = np.hstack([padded[k] for k in order])
    thick = max(1, round(height / 240))
    for seam in np.cumsum([padded[k].shape[1] for k in order])[:-1].tolist():
        drawn[:, seam - thick : seam], drawn[:, seam : seam + thick] = 0, 255
    return drawn


def AddCaption(views: Image, text: str) -> Image:
    """A strip below views: what the outline is, and a line of text.

    Args:
        views: An RGB image of `DrawViews`, shape (height, width, 3).
        text: The line; letters that are not ASCII show as question marks.

    Returns:
        An RGB image of the same width, a fifteenth higher.

    Example:
        >>> AddCaption(np.zeros((480, 1280, 3), dtype=np.uint8), "t = 1.2 s").shape
        (512, 1280, 3)
    """
    import cv2

    height, width = views.shape[:2]
    strip = np.full((max(1, round(height / 15)), width, 3), 40, dtype=np.uint8)
    high, middle, font = len(strip), len(strip) // 2, cv2.FONT_HERSHEY_SIMPLEX
    scale, line = high / 50.0, (high, 2 * high)
    for color, thickness in (((255, 255, 255), max(2, high // 8)), ((0, 0, 0), max(1, high // 16))):
        cv2.line(strip, (line[0] // 2, middle), (line[1], middle), color, thickness, cv2.LINE_AA)
    start = line[1] + high // 2
    (legend, _), _ = cv2.getTextSize(_LEGEND, font, scale, 1)
    for words, left, room in (
        (_LEGEND, start, width - start),
        (text, start + legend + high, width - start - legend - 2 * high),
    ):
        needed = cv2.getTextSize(words, font, scale, 1)[0][0]
        fitting = scale * min(1.0, max(room, 1) / max(needed, 1))
        place = (left, middle + round(11 * fitting))
        cv2.putText(strip, words, place, font, fitting, (255, 255, 255), 1, cv2.LINE_AA)
    return np.vstack([views, strip])
