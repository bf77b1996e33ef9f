"""Exact images of colored convex solids by ray casting, and poses to draw them at.

Nothing of mffdrake computes anything here: solids and cameras are read as plain data, rotations
and lenses come from OpenCV and colors from `colorsys`.
"""

import colorsys
import math

import cv2
import numpy as np

from mffdrake.recognition import Camera, CameraRig, Distortion, SearchRange, SolidModel

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


def render(solid, psi, rig, *, supersampling=1, brightness=1.0, background=GREY):
    """Images of a solid, one a camera, RGB uint8: every ray takes the face where it enters.

    Args:
        solid: `SolidModel`.
        psi: Pose vector of the solid in the rig's frame.
        rig: `CameraRig`.
        supersampling: Rays a pixel along u and along v. One ray, through the pixel's center,
            gives an image without blended pixels; more are averaged.
        brightness: HSV value of the faces.
        background: Grey level of everything else.
    """
    return tuple(
        _render_one(solid, psi, camera, supersampling, brightness, background)
        for camera in rig.cameras
    )


def _render_one(solid, psi, camera, supersampling, brightness, background):
    """Image of one camera."""
    R_KM, p_KM = in_camera(psi, camera)
    corners = solid.vertices @ R_KM.T + p_KM
    assert corners[:, 2].min() > 0.0, "the solid must stand in front of the camera"
    image = np.full((camera.height, camera.width, 3), background, dtype=np.uint8)
    # Only the pixels around the projected edges, which a lens may bend, can show the solid.
    shares = np.linspace(0.0, 1.0, 2 if camera.distortion.model == "none" else 12)
    first, last = corners[solid.edges[:, 0], None], corners[solid.edges[:, 1], None]
    u, v = project(camera, (first + shares[:, None] * (last - first)).reshape(-1, 3)).T
    first_u, last_u = np.clip([u.min() - 2, u.max() + 2], 0, camera.width - 1).astype(int)
    first_v, last_v = np.clip([v.min() - 2, v.max() + 2], 0, camera.height - 1).astype(int)
    columns, rows = np.arange(first_u, last_u + 1), np.arange(first_v, last_v + 1)
    normals = solid.normals @ R_KM.T
    heights = np.einsum("fk,fk->f", normals, solid.centers @ R_KM.T + p_KM)
    palette = [[background] * 3] + [
        [255.0 * c for c in colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 1.0, brightness)]
        for hue in solid.hues
    ]
    palette = np.array(palette)

    def color(u, v):
        """The color that a ray meets; the row in the palette."""
        x, y = unproject(camera, u, v)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        # The plane of face f is met at depth heights[f] / rate[f]; a negative rate enters
        # the half-space behind it, a positive one leaves it.
        rate = rays @ normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = heights / rate
        entries = np.where(rate < 0, depth, -np.inf)
        leave = np.where(rate > 0, depth, np.inf).min(axis=-1)
        hit = (entries.max(axis=-1) < leave) & (leave > 0)
        return np.where(hit, 1 + entries.argmax(axis=-1), 0)

    middle_u, middle_v = np.meshgrid(columns.astype(float), rows.astype(float))
    shown = color(middle_u, middle_v)
    if supersampling == 1:
        image[first_v : last_v + 1, first_u : last_u + 1] = np.rint(palette[shown])
        return image
    # Only pixels near a border, or a corner, may show more than one color.
    around = np.ones((5, 5), dtype=np.uint8)
    flat = shown.astype(np.uint8)
    mixed = cv2.dilate(flat, around) != cv2.erode(flat, around)
    for corner_u, corner_v in project(camera, corners):
        mixed |= np.maximum(np.abs(middle_u - corner_u), np.abs(middle_v - corner_v)) < 8.0
    total = np.zeros((*shown.shape, 3))
    offsets = (np.arange(supersampling) + 0.5) / supersampling - 0.5
    for dv in offsets:
        for du in offsets:
            shown[mixed] = color(middle_u[mixed] + du, middle_v[mixed] + dv)
            total += palette[shown]
    image[first_v : last_v + 1, first_u : last_u + 1] = np.rint(total / supersampling**2)
    return image


def in_camera(psi, camera):
    """Rotation and position [m] of a solid in a camera's own frame K."""
    R_KC = camera.R_CK.T
    return R_KC @ rotation(psi[3:]), R_KC @ (np.asarray(psi[:3]) - camera.p_CK)


def project(camera, p_K):
    """Pixels of points before a camera, in its own frame, shape (n, 3), by OpenCV."""
    if camera.distortion.model == "none":
        return p_K[:, :2] / p_K[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    K, k = intrinsics(camera), np.array(camera.distortion.coefficients)
    points, still = np.ascontiguousarray(p_K, dtype=float).reshape(-1, 1, 3), np.zeros(3)
    if camera.distortion.model == "equidistant":
        return cv2.fisheye.projectPoints(points, still, still, K, k)[0].reshape(-1, 2)
    return cv2.projectPoints(points, still, still, K, k)[0].reshape(-1, 2)


def unproject(camera, u, v):
    """Normalized coordinates (x, y) of pixels, by OpenCV where a lens distorts them."""
    if camera.distortion.model == "none":
        return (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(float)
    K, k = intrinsics(camera), np.array(camera.distortion.coefficients)
    if camera.distortion.model == "equidistant":
        found = cv2.fisheye.undistortPoints(pixels, K, k, criteria=(*_CRITERIA, 1e-13))
    else:
        # OpenCV 4 has another name for the function that takes criteria.
        undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
        found = undistort(pixels, K, k, R=None, P=None, criteria=(*_CRITERIA, 1e-10))
    return found[..., 0].reshape(np.shape(u)), found[..., 1].reshape(np.shape(u))


_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100)


def intrinsics(camera):
    """The camera matrix of OpenCV."""
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def in_all_images(solid, psi, rig, border=12.0):
    """Whether the solid lies in every image, at least ``border`` pixels from its border."""
    for camera in rig.cameras:
        R_KM, p_KM = in_camera(psi, camera)
        corners = solid.vertices @ R_KM.T + p_KM
        if corners[:, 2].min() <= 0.0:
            return False
        middle = 0.5 * np.array([camera.width - 1, camera.height - 1])
        off = np.abs(project(camera, corners) - middle).max(axis=0)
        if (off >= 0.5 * np.array([camera.width, camera.height]) - border).any():
            return False
        # What a lens folds back into the image, OpenCV does not bring back to where it is.
        x, y = unproject(camera, *project(camera, corners).T)
        if np.abs(corners[:, :2] / corners[:, 2:] - np.column_stack([x, y])).max() > 1e-6:
            return False
    return True


def random_poses(rng, count, search_range=None):
    """Poses drawn evenly over a search range, whether they are in view or not."""
    search_range = SearchRange() if search_range is None else search_range
    return rng.uniform(search_range.lower, search_range.upper, size=(count, 6))


def random_poses_in_view(rng, solid, rig, count):
    """Poses of the search range at which all cameras see the whole solid."""
    found = []
    while len(found) < count:
        found += [psi for psi in random_poses(rng, count) if in_all_images(solid, psi, rig)]
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


def small_rig():
    """A pair of few pixels, for tests that draw many images or count single pixels."""
    return CameraRig.stereo(width=160, height=120, focal_length=145.0, baseline=0.150)


LENSES = {
    "none": Distortion(),
    "barrel": Distortion("plumb_bob", (-0.28, 0.09, 1.5e-3, -1.0e-3)),
    "pincushion": Distortion("plumb_bob", (0.12, 0.05, -1.0e-3, 8.0e-4, 0.02)),
    "rational": Distortion("plumb_bob", (0.35, 0.06, 5e-4, -7e-4, 0.004, 0.62, 0.11, 0.01)),
    "equidistant": Distortion("equidistant", (0.04, -0.012, 0.005, -0.001)),
}
"""Lenses as calibrations give them, by name."""


def odd_camera(lens, *, name="odd", p_CK=(-0.16, 0.03, -0.02), width=640, height=480, **kwargs):
    """A camera that is rolled, turned and shifted, its pixels not square and off its center."""
    size = height / 480.0
    return Camera(
        **{
            "name": name, "width": width, "height": height,
            "fx": 590.0 * size, "fy": 575.0 * size,
            "cx": 0.5 * width + 7.3 * size, "cy": 0.5 * height - 11.8 * size,
            "distortion": LENSES[lens],
            "R_CK": cv2.Rodrigues(np.array([0.05, 0.11, 0.35]))[0], "p_CK": p_CK,
        } | kwargs
    )  # fmt: skip


def odd_rig(*lenses):
    """The plain pair's right camera and an odd one, or several at different places, of lenses."""
    places = ((-0.16, 0.03, -0.02), (-0.07, -0.14, 0.03))
    odd = [
        odd_camera(lens, name=f"odd {k}", p_CK=p_CK)
        for k, (lens, p_CK) in enumerate(zip(lenses, places, strict=False))
    ]
    return CameraRig((CameraRig.stereo().cameras[0], *odd))
