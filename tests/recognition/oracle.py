"""The fitness of `mffdrake.recognition.fitness.matching`, point by point, slowly and independently.

Works in the camera's frame, where the compiled kernel works in the target's; takes hues from
`colorsys`, rotations and lenses from OpenCV. From the search model it reads the sampled points,
from the solid its corners, faces and hues, from the cameras their numbers.
"""

import colorsys
import functools
import math
from dataclasses import dataclass, field

import numpy as np
from synthetic import in_camera, project

from mffdrake.recognition import Camera, Distortion


@dataclass
class Score:
    """What one camera sees of one hypothesis.

    Attributes:
        inside: Counted inside points, Lambda of Eq. (21).
        inside_matches: Those of them on a pixel of their face's hue.
        strip: Points of the strip.
        strip_matches: Those of them on a pixel of any hue of the model.
        visible: Whether each face is visible.
        points: The counted inside points in the camera's frame, where they were moved to, each
            with its face's sides.
    """

    inside: int = 0
    inside_matches: int = 0
    strip: int = 0
    strip_matches: int = 0
    visible: list = field(default_factory=list)
    points: list = field(default_factory=list)

    @property
    def fitness(self):
        """F of this camera, Eq. (21)."""
        if self.inside == 0:
            return 0.0
        return max(0.0, (self.inside_matches - self.strip_matches) / self.inside)


def fitness(matcher, psi, images):
    """F of all cameras, Eq. (22)."""
    return float(np.mean([score.fitness for score in scores(matcher, psi, images)]))


def scores(matcher, psi, images):
    """Scores of the cameras."""
    return [
        _score(matcher, psi, image, camera)
        for image, camera in zip(images, matcher.rig.cameras, strict=True)
    ]


def magnification(camera, p_K):
    """Pixels a unit of normalized length near a point: the root of what areas grow by."""
    h = 1e-5
    near = np.array([[h, 0.0], [-h, 0.0], [0.0, h], [0.0, -h]]) + p_K[:2] / p_K[2]
    right, left, below, above = project(camera, np.column_stack([near, np.ones(4)]))
    D = np.column_stack([right - left, below - above]) / (2.0 * h)
    return math.sqrt(abs(np.linalg.det(D)))


@functools.cache
def fold_radius(camera):
    """The normalized radius up to which the image grows with it, by trying all of them."""
    radii = np.arange(1, 100_000) * 1e-4
    k = np.array(camera.distortion.coefficients)
    if camera.distortion.model == "plumb_bob":
        k[2:4] = 0.0  # the symmetric part alone
    plain = Camera(
        width=1, height=1, fx=1.0, fy=1.0, cx=0.0, cy=0.0,
        distortion=Distortion(camera.distortion.model, tuple(k)),
    )  # fmt: skip
    zero = np.zeros_like(radii)
    image = project(plain, np.column_stack([radii, zero, zero + 1.0]))[:, 0]
    falling = np.flatnonzero(np.diff(image) <= 0.0)
    return radii[falling[0]] if len(falling) else math.inf


def _score(matcher, psi, image, camera):
    model, solid, p = matcher.search_model, matcher.solid, matcher.parameters
    R, origin = in_camera(psi, camera)
    f = magnification(camera, origin)
    border = p.min_border_distance + camera.calibration_error
    corners = solid.vertices @ R.T + origin
    middle = corners.mean(axis=0)
    score, wanted = Score(), []
    for k, face in enumerate(solid.faces):
        around = [corners[i] for i in face]
        normal = np.cross(around[1] - around[0], around[2] - around[1])
        normal /= np.linalg.norm(normal)
        center = np.mean(around, axis=0)
        score.visible.append(-normal @ center > p.min_cosine * np.linalg.norm(center))
        if not score.visible[-1]:
            continue
        sides = list(zip(around, around[1:] + around[:1], strict=True))
        limits = [_limit(a, b, normal, f, border) for a, b in sides]
        for point in model.inside_points[model.inside_start[k] : model.inside_start[k + 1]]:
            q = _move_inward(R @ point + origin, limits)
            if q is None:
                continue
            score.points.append((q, sides))
            wanted.append(k)
    shown = _shown(image, [q for q, _ in score.points], camera, matcher)
    score.inside = len(wanted)
    score.inside_matches = sum(k in faces for k, faces in zip(wanted, shown, strict=True))
    strip = []
    for k, (i, j) in enumerate(solid.edges):
        faces = [n for n, face in enumerate(solid.faces) if i in face and j in face]
        if score.visible[faces[0]] == score.visible[faces[1]]:
            continue
        # The line of sight along the edge sweeps a plane; the strip stands perpendicular to it.
        outward = np.cross(corners[i], corners[j])
        outward /= np.linalg.norm(outward)
        if outward @ (middle - corners[i]) > 0:
            outward = -outward
        along = model.edge_points[model.edge_start[k] : model.edge_start[k + 1]] @ R.T + origin
        least = border * along[0][2] / f
        strip += [q + max(r, least) * outward for q in along for r in model.strip_offsets]
    score.strip = len(strip)
    score.strip_matches = sum(bool(faces) for faces in _shown(image, strip, camera, matcher))
    return score


def _limit(a, b, normal, f, pixels):
    """A point of a face's side a-b, the direction inward, and how far off a point must be [m].

    That is the given distance in the image, reckoned at the depth of the side's middle; it is
    negative, hence no limit, for a side behind the camera.
    """
    along = (b - a) / np.linalg.norm(b - a)
    inward = np.cross(normal, along)
    sight_plane = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    pixels_per_meter = f * abs(inward @ sight_plane) / (0.5 * (a + b)[2])
    return a, inward, 0.0 if pixels_per_meter == 0.0 else pixels / pixels_per_meter


def _move_inward(q, limits):
    """A point moved off all sides to which it is too near, or None if it is near another then."""
    missing = [max(0.0, least - (q - a) @ inward) for a, inward, least in limits]
    if not any(missing):
        return q
    moved = q + sum(m * inward for m, (_, inward, _) in zip(missing, limits, strict=True))
    clear = all((moved - a) @ inward > (1 - 1e-9) * least for a, inward, least in limits)
    return moved if clear else None


def border_distances(score, f):
    """Exact distance of each counted point to the nearest side of its face in the image [px]."""
    return [min(_pixels_from_side(q, a, b, f) for a, b in sides) for q, sides in score.points]


def _pixels_from_side(q, a, b, f):
    """Distance in the image from a point to the line through the projected side a-b."""
    a, b, q = (f * x[:2] / x[2] for x in (a, b, q))
    along = (b - a) / np.linalg.norm(b - a)
    return abs(along[0] * (q - a)[1] - along[1] * (q - a)[0])


def _shown(image, points, camera, matcher):
    """For each point the faces whose color its pixel shows, a set."""
    if not points:
        return []
    q = np.array(points)
    x, y = q[:, :2].T / q[:, 2]
    seen = (q[:, 2] > 0) & (np.hypot(x, y) < 0.999 * fold_radius(camera))  # a little less
    pixels = np.full((len(q), 2), -1)
    pixels[seen] = np.floor(project(camera, q[seen]) + 0.5)
    return [
        shown_faces(image[v, u, :3], matcher.solid.hues, matcher.parameters)
        if 0 <= u < camera.width and 0 <= v < camera.height
        else set()
        for u, v in pixels
    ]


def shown_faces(rgb, hues, p):
    """The faces of given hues whose color an 8-bit pixel shows, a set.

    Colors are told to 6 bits a channel, by the middle of the four values that those mean. Of
    different hues within the tolerance the nearest is shown.
    """
    cell = (4 * (int(c) // 4) + 1.5 for c in rgb)
    hue, saturation, value = colorsys.rgb_to_hsv(*(c / 255 for c in cell))
    if saturation == 0 or saturation < p.min_saturation or value < p.min_value:
        return set()
    if saturation * value < p.min_chroma:
        return set()
    away = [abs(math.remainder(2.0 * math.pi * hue - wanted, 2.0 * math.pi)) for wanted in hues]
    if min(away) > math.radians(p.hue_tolerance_deg):
        return set()
    return {k for k, hue in enumerate(hues) if hue == hues[int(np.argmin(away))]}
