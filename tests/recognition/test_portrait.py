"""A portrait shows the very faces that rays meet first."""

from pathlib import Path

import numpy as np
import pytest

from mffdrake.recognition import SearchModel, SolidModel
from mffdrake.recognition.visibility.portrait import Portrait

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("name", ["mug", "hammer", "target_box"])
@pytest.mark.parametrize("direction", [(3, 2, 2), (-2, 1, -6), (0, 0, 1)])
def test_each_pixel_shows_the_face_that_its_ray_meets_first(name, direction):
    solid = SolidModel.from_mesh_file(MODELS / f"{name}.obj")
    seen = Portrait.of(SearchModel(solid), np.array(direction) / np.linalg.norm(direction), 60)
    a, b, c = solid.triangles.transpose(1, 0, 2)
    wrong = 0
    for row in range(0, 60, 3):
        for column in range(0, 60, 3):
            x, y = (np.array([column, row]) - 29.5) / seen.focal_length
            ray = seen.axes.T @ [x, y, 1.0]
            h = np.cross(ray, c - a)
            det = np.einsum("tk,tk->t", h, b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = (seen.place - a) / det[:, None]
                u = np.einsum("tk,tk->t", s, h)
                q = np.cross(s, b - a)
                v, t = q @ ray, np.einsum("tk,tk->t", q, c - a)
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
            first = -1
            if hit.any():
                first = solid.triangle_faces[np.argmin(np.where(hit, t, np.inf))]
            wrong += first != seen.faces[row, column]
    assert wrong <= 2  # of 400, at edges


def test_its_upper_side_is_that_of_the_solid_and_nothing_is_mirrored():
    model = SearchModel(SolidModel.from_mesh_file(MODELS / "hammer.obj"))
    seen = Portrait.of(model, np.array([1.0, 0.0, 0.0]))  # y then points to the right.
    middle = model.solid.vertices.mean(axis=0)
    u, v = (seen.project(middle + 0.01 * np.eye(3)) - seen.project(middle[None])).T
    assert u[1] > 1.0 and abs(v[1]) < 0.1
    assert v[2] < -1.0 and abs(u[2]) < 0.1


def test_points_that_are_seen_lie_on_their_faces():
    model = SearchModel(SolidModel.from_mesh_file(MODELS / "l_block.obj"))
    seen = Portrait.of(model, np.array([0.6, 0.0, 0.8]))
    assert 20 < len(seen.points) < len(model.inside_points)
    columns, rows = np.rint(seen.points).astype(int).T
    assert (seen.faces[rows, columns] >= 0).mean() > 0.99
