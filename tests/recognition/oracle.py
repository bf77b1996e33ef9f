"""The fitness of `mffdrake.recognition.matching`, point by point, slowly and independently.

Works in the camera's frame, where the compiled kernel works in the target's; takes hues from
`colorsys` and rotations from OpenCV. From the search model it reads the sampled points, from the
solid its corners, faces and hues.
"""

import colorsys
import math
from dataclasses import dataclass, field

import numpy as np
from synthetic import rotation


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


def fitness(matcher, psi, image_right, image_left):
    """F of both cameras, Eq. (22)."""
    right, left = scores(matcher, psi, image_right, image_left)
    return 0.5 * (right.fitness + left.fitness)


def scores(matcher, psi, image_right, image_left):
    """Scores of the right and the left camera."""
    baseline = np.array([-matcher.camera.baseline, 0.0, 0.0])
    return (
        _score(matcher, psi, image_right, np.zeros(3)),
        _score(matcher, psi, image_left, baseline),
    )


def _score(matcher, psi, image, p_CO):
    model, solid = matcher.search_model, matcher.search_model.solid
    p, f = matcher.parameters, matcher.camera.focal_length
    R = rotation(psi[3:])
    origin = np.asarray(psi[:3]) - p_CO
    corners = solid.vertices @ R.T + origin
    middle = corners.mean(axis=0)
    score = Score()
    for k, face in enumerate(solid.faces):
        around = [corners[i] for i in face]
        normal = np.cross(around[1] - around[0], around[2] - around[1])
        normal /= np.linalg.norm(normal)
        center = np.mean(around, axis=0)
        score.visible.append(-normal @ center > p.min_cosine * np.linalg.norm(center))
        if not score.visible[-1]:
            continue
        sides = list(zip(around, around[1:] + around[:1], strict=True))
        limits = [_limit(a, b, normal, f, p.min_border_distance) for a, b in sides]
        for point in model.inside_points[model.inside_start[k] : model.inside_start[k + 1]]:
            q = _move_inward(R @ point + origin, limits)
            if q is None:
                continue
            score.inside += 1
            score.points.append((q, sides))
            hue = _hue_at(image, q, f, p)
            score.inside_matches += _same(hue, solid.hues[k], p)
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
        least = p.min_border_distance * along[0][2] / f
        for q in along:
            for offset in model.strip_offsets:
                hue = _hue_at(image, q + max(offset, least) * outward, f, p)
                score.strip += 1
                score.strip_matches += any(_same(hue, wanted, p) for wanted in solid.hues)
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


def _hue_at(image, q, f, p):
    """Hue [rad] of the pixel that shows a point, or None."""
    height, width = image.shape[:2]
    if q[2] <= 0:
        return None
    u = math.floor(f * q[0] / q[2] + (width - 1) / 2 + 0.5)
    v = math.floor(f * q[1] / q[2] + (height - 1) / 2 + 0.5)
    if not (0 <= u < width and 0 <= v < height):
        return None
    hue, saturation, value = colorsys.rgb_to_hsv(*(int(c) / 255 for c in image[v, u, :3]))
    if saturation == 0 or saturation < p.min_saturation or value < p.min_value:
        return None
    return 2.0 * math.pi * hue


def _same(hue, wanted, p):
    """Whether a hue is the wanted one, within the tolerance around the color circle."""
    if hue is None:
        return False
    turn = math.remainder(hue - wanted, 2.0 * math.pi)
    return abs(turn) <= math.radians(p.hue_tolerance_deg)
