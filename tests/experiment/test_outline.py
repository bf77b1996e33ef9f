"""The drawn outline against the solid's edges, projected by OpenCV point by point."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from mffdrake.recognition import BLUE, GREEN, RED, Camera, CameraRig, Distortion, SolidModel
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.visibility.outline import DrawOutline

MODELS = Path(__file__).parents[2] / "models"
BOX = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
GREY = np.full((240, 320, 3), 128, dtype=np.uint8)
LENSES = {
    "none": Distortion(),
    "plumb_bob": Distortion("plumb_bob", (-0.4, 0.12, 2e-3, -1e-3)),
    "equidistant": Distortion("equidistant", (-0.2, 0.03, 0.0, 0.0)),
}
POSES = {
    "three faces": [0.0, 0.0, 0.5, 0.3, 0.3, 0.1],
    "one face": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
    "partly outside": [0.25, 0.15, 0.5, -0.2, 0.5, 0.1],
}


def camera_with(lens):
    return Camera(
        width=320, height=240, fx=300.0, fy=310.0, cx=155.0, cy=123.0, distortion=lens,
        R_CK=cv2.Rodrigues(np.array([0.05, -0.1, 0.2]))[0], p_CK=np.array([0.02, -0.03, 0.01]),
    )  # fmt: skip


RIM = 9  # A line beside the image is as thick as one within.


def edge_pixels(pose, camera, *, hidden):
    """Where the visible (or the hidden) edges lie, closely sampled: a mask with a rim around."""
    R_CM, p_CM = transform_from_pose(np.array(pose))
    p_MK = R_CM.T @ (camera.p_CK - p_CM)
    facing = np.einsum("fk,fk->f", BOX.normals, p_MK - BOX.centers) > 0.0
    # Also where an edge runs away from the camera and is short in the image
    shares = np.concatenate([np.linspace(0, 1, 2000), np.geomspace(1e-7, 1, 4000)])[:, None]
    shares = np.concatenate([shares, 1.0 - shares])
    mask = np.zeros((camera.height + 2 * RIM, camera.width + 2 * RIM), dtype=bool)
    for (start, end), faces in zip(BOX.vertices[BOX.edges], BOX.edge_faces, strict=True):
        if facing[faces].any() == hidden:
            continue
        p_C = (start + shares * (end - start)) @ R_CM.T + p_CM
        p_K = ((p_C - camera.p_CK) @ camera.R_CK)[:, None]
        K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
        lens, still = np.array(camera.distortion.coefficients), np.zeros(3)
        if camera.distortion.model == "equidistant":
            pixels, _ = cv2.fisheye.projectPoints(p_K, still, still, K, lens)
        else:
            pixels, _ = cv2.projectPoints(p_K, still, still, K, lens)
        u, v = np.rint(np.clip(pixels.reshape(-1, 2), -99, 1e4)).astype(int).T + RIM
        inside = (u >= 0) & (u < mask.shape[1]) & (v >= 0) & (v < mask.shape[0])
        mask[v[inside], u[inside]] = True
    return mask


def in_image(mask):
    return mask[RIM:-RIM, RIM:-RIM]


def distance_to(mask):
    """Distance of every pixel from the nearest one in a mask [px]."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def assert_on_edges(drawn, pose, camera):
    edges = edge_pixels(pose, camera, hidden=False)
    changed, dark = np.any(drawn != GREY, axis=2), drawn.max(axis=2) < 100
    assert in_image(edges).sum() > 100
    assert in_image(distance_to(edges))[changed].max() <= 3.0
    assert distance_to(dark)[in_image(edges)].max() <= 1.5


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
@pytest.mark.parametrize("lens", LENSES)
def test_the_outline_lies_on_the_visible_edges(lens, pose):
    camera = camera_with(LENSES[lens])
    assert_on_edges(DrawOutline(GREY, pose, BOX, camera), pose, camera)


def test_hidden_edges_are_not_drawn():
    pose, camera = POSES["three faces"], camera_with(LENSES["plumb_bob"])
    drawn = DrawOutline(GREY, pose, BOX, camera)
    apart = distance_to(edge_pixels(pose, camera, hidden=False)) > 3.0
    hidden = in_image(edge_pixels(pose, camera, hidden=True) & apart)
    assert hidden.sum() > 50
    assert (drawn[hidden] == 128).all()


def test_a_bent_edge_is_not_straight():
    """What the test above rests on: without its lens the outline would lie elsewhere."""
    pose = POSES["partly outside"]
    for lens in ("plumb_bob", "equidistant"):
        straight = DrawOutline(GREY, pose, BOX, camera_with(LENSES["none"]))
        edges = edge_pixels(pose, camera_with(LENSES[lens]), hidden=False)
        assert in_image(distance_to(edges))[np.any(straight != GREY, axis=2)].max() > 6.0


def test_edges_that_come_close_to_the_camera_keep_their_direction():
    """Corners a micrometer before its plane are millions of pixels away."""
    camera = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
    pose = [0.09, 0.1, 0.1 + 1e-6, 0.0, 0.0, 0.0]
    assert np.nanmax(camera.project(BOX.vertices + pose[:3])) > 1e6
    assert_on_edges(DrawOutline(GREY, pose, BOX, camera), pose, camera)


def test_what_is_behind_the_camera_is_not_drawn():
    camera = camera_with(LENSES["none"])
    for z in (-0.5, 0.0):
        drawn = DrawOutline(GREY, [0.3, 0.0, z, 0.0, 0.0, 0.0], BOX, camera)
        if z < -0.1:
            np.testing.assert_array_equal(drawn, GREY)
        assert drawn.shape == GREY.shape


def test_bends_of_a_curved_surface_are_drawn_where_they_are_its_silhouette_alone():
    mug = SolidModel.from_mesh_file(MODELS / "mug.obj")
    camera = CameraRig.stereo().cameras[0]
    grey = np.full((480, 640, 3), 128, dtype=np.uint8)
    # Its axis lies across the line of sight, so that its outer wall is a band in the middle.
    pose = [0.0, 0.0, 0.4, 0.0, np.sqrt(0.5), 0.0]
    drawn = DrawOutline(grey, pose, mug, camera)
    row = np.any(drawn[:, 340] != 128, axis=1)  # a column of the image, across the wall
    lines = np.count_nonzero(np.diff(row.astype(int)) == 1)
    # The wall's two silhouettes and at most those inside, which stands as if it was of glass
    assert 2 <= lines <= 4
