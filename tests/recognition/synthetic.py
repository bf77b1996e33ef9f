"""Exact stereo images of colored convex solids by ray casting, and poses to draw them at.

Nothing of mffdrake computes anything here: solids and cameras are read as plain data, rotations
come from OpenCV and colors from `colorsys`.
"""

import colorsys
import math

import cv2
import numpy as np

from mffdrake.recognition import SearchRange, SolidModel, StereoCamera

GREY = 128
BOX_SIZE = (0.100, 0.150, 0.200)
PAPER_POSITION = (0.0, 0.155, 0.800)
ARC_EPS2 = math.sin(math.radians(7.5))
"""Greatest |eps2| of the paper's arc: the hand swings by 15 deg to both sides."""


def rotation(eps):
    """Rotation matrix of a quaternion's vector part (eta >= 0), as axis and angle."""
    eps = np.asarray(eps, dtype=float)
    sine = np.linalg.norm(eps)
    if sine == 0.0:
        return np.eye(3)
    return cv2.Rodrigues(eps / sine * 2.0 * math.asin(min(1.0, sine)))[0]


def quaternion_vector(R):
    """Vector part of the quaternion (eta >= 0) of one rotation matrix, by axis and angle."""
    vector = cv2.Rodrigues(np.asarray(R, dtype=float))[0].ravel()
    angle = np.linalg.norm(vector)
    return np.zeros(3) if angle == 0.0 else vector / angle * math.sin(0.5 * angle)


def pose(position, eps=(0.0, 0.0, 0.0)):
    """Pose vector of a position [m] and a quaternion's vector part."""
    return np.array([*position, *eps], dtype=float)


def render(solid, psi, camera, *, supersampling=1, brightness=1.0, background=GREY):
    """Right and left image of a solid, RGB uint8: every ray takes the face where it enters.

    Args:
        solid: `SolidModel`.
        psi: Pose vector of the solid in the right camera's frame.
        camera: `StereoCamera`.
        supersampling: Rays a pixel along u and along v. One ray, through the pixel's center,
            gives an image without blended pixels; more are averaged.
        brightness: HSV value of the faces.
        background: Grey level of everything else.
    """
    return tuple(
        _render_one(solid, psi, camera, p_CO, supersampling, brightness, background)
        for p_CO in (np.zeros(3), np.array([-camera.baseline, 0.0, 0.0]))
    )


def _render_one(solid, psi, camera, p_CO, supersampling, brightness, background):
    """Image of the camera whose center stands at ``p_CO`` in the frame C."""
    R_CM, p_OM = rotation(psi[3:]), np.asarray(psi[:3]) - p_CO
    corners = solid.vertices @ R_CM.T + p_OM
    assert corners[:, 2].min() > 0.0, "the solid must stand in front of the camera"
    cu, cv = (camera.width - 1) / 2.0, (camera.height - 1) / 2.0
    image = np.full((camera.height, camera.width, 3), background, dtype=np.uint8)
    # Only the pixels around the projected corners can show the solid.
    u = camera.focal_length * corners[:, 0] / corners[:, 2] + cu
    v = camera.focal_length * corners[:, 1] / corners[:, 2] + cv
    first_u, last_u = np.clip([u.min() - 2, u.max() + 2], 0, camera.width - 1).astype(int)
    first_v, last_v = np.clip([v.min() - 2, v.max() + 2], 0, camera.height - 1).astype(int)
    columns, rows = np.arange(first_u, last_u + 1), np.arange(first_v, last_v + 1)
    normals = solid.normals @ R_CM.T
    heights = np.einsum("fk,fk->f", normals, solid.centers @ R_CM.T + p_OM)
    palette = [[background] * 3] + [
        [255.0 * c for c in colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 1.0, brightness)]
        for hue in solid.hues
    ]
    palette = np.array(palette)
    total = np.zeros((len(rows), len(columns), 3))
    offsets = (np.arange(supersampling) + 0.5) / supersampling - 0.5
    for dv in offsets:
        for du in offsets:
            x, y = np.meshgrid(
                (columns + du - cu) / camera.focal_length, (rows + dv - cv) / camera.focal_length
            )
            rays = np.stack([x, y, np.ones_like(x)], axis=-1)
            # The plane of face f is met at depth heights[f] / rate[f]; a negative rate enters
            # the half-space behind it, a positive one leaves it.
            rate = rays @ normals.T
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = heights / rate
            entries = np.where(rate < 0, depth, -np.inf)
            leave = np.where(rate > 0, depth, np.inf).min(axis=-1)
            hit = (entries.max(axis=-1) < leave) & (leave > 0)
            total += palette[np.where(hit, 1 + entries.argmax(axis=-1), 0)]
    image[first_v : last_v + 1, first_u : last_u + 1] = np.rint(total / supersampling**2)
    return image


def in_both_images(solid, psi, camera, border=12.0):
    """Whether the solid lies in both images, at least ``border`` pixels from their borders."""
    corners = solid.vertices @ rotation(psi[3:]).T + psi[:3]
    if corners[:, 2].min() <= 0.0:
        return False
    half_width, half_height = camera.width / 2.0 - border, camera.height / 2.0 - border
    scale = camera.focal_length / corners[:, 2]
    right = np.abs(scale * corners[:, 0]).max()
    left = np.abs(scale * (corners[:, 0] + camera.baseline)).max()
    return max(right, left) < half_width and np.abs(scale * corners[:, 1]).max() < half_height


def random_poses(rng, count, search_range=None):
    """Poses drawn evenly over a search range, whether they are in view or not."""
    search_range = SearchRange() if search_range is None else search_range
    return rng.uniform(search_range.lower, search_range.upper, size=(count, 6))


def random_poses_in_view(rng, solid, camera, count):
    """Poses of the search range at which both cameras see the whole solid."""
    found = []
    while len(found) < count:
        found += [psi for psi in random_poses(rng, count) if in_both_images(solid, psi, camera)]
    return np.array(found[:count])


def arc_poses(count):
    """Poses along the paper's arc: the target keeps its place and turns about y."""
    return np.array([pose(PAPER_POSITION, (0, e, 0)) for e in np.linspace(-1, 1, count) * ARC_EPS2])


def paper_box():
    """The paper's box: 100 x 150 x 200 mm, red, green and blue."""
    return SolidModel.box(BOX_SIZE, np.radians([0.0, 120.0, 240.0]))


def hexagonal_prism(radius=0.08, height=0.16):
    """An upright prism along z with eight faces of eight hues."""
    angles = np.radians(60.0 * np.arange(6))
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = [(*p, z) for z in (-0.5 * height, 0.5 * height) for p in ring]
    sides = [(i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i) for i in range(6)]
    faces = [(5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11), *sides]
    return SolidModel(vertices, faces, np.radians(45.0 * np.arange(8)))


def tetrahedron(size=0.16):
    """A regular tetrahedron around the origin with four hues."""
    vertices = 0.5 * size * np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
    return SolidModel(vertices, faces, np.radians([10.0, 100.0, 190.0, 280.0]))


def small_camera():
    """A camera of few pixels, for tests that draw many images or count single pixels."""
    return StereoCamera(width=160, height=120, focal_length=145.0, baseline=0.150)
