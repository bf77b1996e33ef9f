"""What is seen of a solid from where: against rays that are cast at its triangles."""

from pathlib import Path

import numba
import numpy as np
import pytest
import trimesh

from mffdrake.recognition import CameraRig, Matcher, SearchModel, SolidModel

_aspects = pytest.importorskip("mffdrake.recognition.visibility.drawing")
MODELS = Path(__file__).parents[2] / "models"
NAMES = ("l_block", "notched_box", "hammer", "mug")
DIRECTIONS = 24


@pytest.fixture(scope="module", params=NAMES)
def known(request):
    """A solid, its search model, and what the compiled functions take of both."""
    solid = SolidModel.from_mesh_file(MODELS / f"{request.param}.obj")
    model = SearchModel(solid)
    outlines_and_more, samples, _ = Matcher(model, CameraRig.stereo()).structs
    return solid, model, outlines_and_more.outlines, samples.visibility


def eyes(solid, seed=0):
    """Places of cameras around a solid."""
    rng = np.random.default_rng(seed)
    middle = solid.vertices.mean(axis=0)
    for _ in range(DIRECTIONS):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        yield middle + rng.uniform(2.5, 4.0) * solid.size * direction, direction


def first_hit(solid, eye, points):
    """Where rays to points first meet the solid: 1 at the points, infinity for never."""
    a, b, c = solid.triangles.transpose(1, 0, 2)
    way = points - eye
    first = np.full(len(points), np.inf)
    for p, q, r in zip(a, b, c, strict=True):
        u, v = q - p, r - p
        h = np.cross(way, v)
        det = h @ u
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (eye - p) / det[:, None]
            x = np.einsum("nk,nk->n", s, h)
            k = np.cross(s, u)
            y = np.einsum("nk,nk->n", k, way)
            t = k @ v
        hit = (x >= 0) & (y >= 0) & (x + y <= 1) & (t > 0)
        first[hit] = np.minimum(first[hit], t[hit])
    return first


def facing(solid, eye):
    return np.einsum("fk,fk->f", solid.normals, eye - solid.centers) > 0.0


def parts(start, values, aspect):
    return values[start[aspect] : start[aspect + 1]]


def test_inside_points_that_count_are_hidden_by_nothing(known):
    solid, model, _, sight = known
    owners = np.repeat(np.arange(len(solid.faces)), np.diff(model.inside_start))
    wrong = right = missed = 0
    for eye, direction in eyes(solid):
        aspect = _aspects.aspect_of(*direction, sight.grid)
        looks = facing(solid, eye)[owners]
        hidden = first_hit(solid, eye, model.inside_points) < 1.0 - 1e-6
        shown = sight.shown[aspect]
        wrong += (looks & shown & hidden).sum()
        right += (looks & shown & ~hidden).sum()
        missed += (looks & ~shown & ~hidden).sum()
        needed = set(parts(sight.faces_start, sight.faces, aspect).tolist())
        assert set(owners[looks & ~hidden & shown].tolist()) <= needed
    assert wrong <= 0.005 * right
    assert missed <= 0.15 * right  # near what hides, nothing is sure in a whole aspect


def test_the_strip_lies_outside_the_solid(known):
    solid, model, _, sight = known
    wrong = right = 0
    edge = np.repeat(np.arange(len(solid.edges)), np.diff(model.edge_start))
    for eye, direction in eyes(solid, 1):
        aspect = _aspects.aspect_of(*direction, sight.grid)
        looks, strip = facing(solid, eye), []
        for entry in range(sight.edges_start[aspect], sight.edges_start[aspect + 1]):
            k = sight.edges[entry]
            first, second = looks[solid.edge_faces[k]]
            if first == second:
                continue
            chosen = slice(sight.points_start[entry], sight.points_start[entry + 1])
            points = model.edge_points[sight.points[chosen]]
            assert (edge[sight.points[chosen]] == k).all()
            n = np.cross(solid.edge_directions[k], points[0] - eye)
            n /= np.linalg.norm(n)
            n *= -np.sign(n @ solid.edge_inward[k, 0 if first else 1])
            for row, offset in enumerate(model.strip_offsets[1:], start=1):
                counts = (sight.rows[chosen] >> row) & 1 > 0
                strip.append(points[counts] + offset * n)
        met = np.isfinite(first_hit(solid, eye, np.concatenate(strip)))
        wrong, right = wrong + met.sum(), right + (~met).sum()
    assert right > 20 * DIRECTIONS and wrong <= 0.01 * right


def test_segments_are_in_full_view(known):
    solid, _, outlines, _ = known
    wrong = right = 0
    for eye, direction in eyes(solid, 2):
        aspect = _aspects.aspect_of(*direction, outlines.grid)
        looks, points = facing(solid, eye), []
        for segment in parts(outlines.start, outlines.segments, aspect):
            seen = looks[outlines.faces[segment]]
            if not seen.any() or (outlines.smooth[segment] and seen.all()):
                continue
            into = outlines.inward[segment, int(not seen[0])]
            a, b = outlines.ends[segment]
            points.append(a + np.array([[0.1], [0.5], [0.9]]) * (b - a) + 2e-3 * into)
        hidden = first_hit(solid, eye, np.concatenate(points)) < 1.0 - 1e-3
        wrong, right = wrong + hidden.sum(), right + (~hidden).sum()
    assert right > 5 * DIRECTIONS and wrong <= 0.02 * right


def test_aspects_are_directions_and_every_direction_has_one():
    grid = 32
    for i in range(grid):
        for j in range(grid):
            corners = [
                _aspects.corner_direction(i + a, j + b, grid) for a in (0, 1) for b in (0, 1)
            ]
            middle = np.sum(corners, axis=0)
            assert _aspects.aspect_of(*middle, grid) == i * grid + j
            spread = np.degrees(np.arccos(np.clip(np.array(corners) @ corners[0], -1, 1)))
            assert spread.max() < 15.2
    assert _aspects.aspect_of(0.1, -0.2, 0.3, 0) == 0


def test_a_convex_solid_with_few_edges_needs_none():
    box = SolidModel.from_mesh_file(MODELS / "target_box.obj")
    solid, samples, _ = Matcher(SearchModel(box), CameraRig.stereo()).structs
    assert solid.outlines.grid == samples.visibility.grid == 0
    np.testing.assert_array_equal(solid.outlines.ends, box.vertices[box.edges])


def test_nothing_is_compiled_anew_for_a_solid_of_another_kind():
    def types(name):
        model = SearchModel(SolidModel.from_mesh_file(MODELS / f"{name}.obj"))
        return [numba.typeof(struct) for struct in Matcher(model, CameraRig.stereo()).structs]

    assert types("target_box") == types("l_block") == types("mug")


@pytest.mark.parametrize("seed", range(3))
def test_nearly_all_of_a_smooth_outline_is_looked_at(seed):
    """No bend is an outline from a corner of an aspect and all over it."""
    triangles = trimesh.creation.icosphere(3).triangles * [0.05, 0.07, 0.09]
    names = len(triangles) * ["red"]
    solid = SolidModel.from_triangles(triangles, np.zeros(len(triangles)), names)
    outlines = Matcher(SearchModel(solid), CameraRig.stereo()).structs[0].outlines
    shares = []
    for eye, _ in eyes(solid, seed):
        first, second = facing(solid, eye)[solid.edge_faces].T
        edges = solid.vertices[solid.edges[first != second]]
        way = (eye - solid.vertices.mean(axis=0)).tolist()
        taken = parts(outlines.start, outlines.segments, _aspects.aspect_of(*way, outlines.grid))
        known = {tuple(np.sort(ends.round(9), axis=0).ravel()) for ends in outlines.ends[taken]}
        found = [tuple(np.sort(ends.round(9), axis=0).ravel()) in known for ends in edges]
        shares.append(np.mean(found))
    assert np.mean(shares) > 0.85 and min(shares) > 0.6
