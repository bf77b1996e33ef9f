"""Colored solids, files of them, and the points they are sampled at: equations (19), (20)."""

import colorsys
import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from synthetic import BOX_SIZE, hexagonal_prism, paper_box, rotation, tetrahedron

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    SamplingParameters,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.solid.mesh_file import ColoredMesh

TARGET_BOX = Path(__file__).parents[2] / "models" / "target_box.obj"
SOLIDS = {"box": paper_box(), "prism": hexagonal_prism(), "tetrahedron": tetrahedron()}
TURNS = [(0, 0, 0), (0.3, -0.2, 0.1), (-0.5, 0.4, 0.3)]  # vector parts of quaternions
EDGES = {"box": 12, "prism": 18, "tetrahedron": 6}
CELLS = SamplingParameters(spacing=0.020, margin=None, strip_offsets=(0.006,))

solids = pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS)


def as_sets(solid):
    """The faces as sets of corner points with their hues, whatever order they stand in."""
    return {
        (frozenset(tuple(p) for p in solid.vertices[list(face)].round(6) + 0.0), round(hue, 5))
        for face, hue in zip(solid.faces, solid.hues, strict=True)
    }


def colors_of(solid):
    """A saturated color (r, g, b) of each face's hue, not quite bright."""
    return [colorsys.hsv_to_rgb(hue / (2 * math.pi), 1.0, 0.8) for hue in solid.hues]


def write_obj(folder, vertices, faces, colors, *, digits=9):
    """An OBJ file with its MTL file, one material a face."""
    materials = [f"newmtl m{k}\nKd {r} {g} {b}\n" for k, (r, g, b) in enumerate(colors)]
    (folder / "solid.mtl").write_text("\n".join(materials))
    lines = ["mtllib solid.mtl"]
    lines += [f"v {x:.{digits}f} {y:.{digits}f} {z:.{digits}f}" for x, y, z in vertices]
    for k, face in enumerate(faces):
        lines += [f"usemtl m{k}", "f " + " ".join(str(i + 1) for i in face)]
    path = folder / "solid.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def sides_of(face):
    return [(face[i], face[(i + 1) % len(face)]) for i in range(len(face))]


def box_with_a_roof(height):
    """Corners and faces of the paper's box, its top replaced by a pyramid up to a height [m]."""
    box = paper_box()
    roof = [(*side, 8) for side in sides_of(box.faces[4])]
    return np.vstack([box.vertices, [0, 0, height]]), [*box.faces[:4], *roof, box.faces[5]]


# Solids


def test_box_has_the_given_size_and_a_hue_for_each_axis():
    box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
    assert (len(box.vertices), len(box.faces), len(box.edges)) == (8, 6, 12)
    np.testing.assert_allclose(np.ptp(box.vertices, axis=0), [0.1, 0.15, 0.2])
    np.testing.assert_allclose(box.vertices.mean(axis=0), 0.0, atol=1e-17)
    for normal, center, hue in zip(box.normals, box.centers, box.hues, strict=True):
        axis = np.argmax(np.abs(normal))
        assert hue == (RED, GREEN, BLUE)[axis]
        np.testing.assert_allclose(center, normal * (0.05, 0.075, 0.1))
    assert len(np.unique(box.normals.round(9), axis=0)) == 6


def test_primary_hues_are_those_of_the_color_circle():
    for hue, color in ((RED, (1, 0, 0)), (GREEN, (0, 1, 0)), (BLUE, (0, 0, 1))):
        assert 2 * math.pi * colorsys.rgb_to_hsv(*color)[0] == pytest.approx(hue)


@pytest.mark.parametrize(
    ("solid", "areas"),
    [
        (paper_box(), [0.03, 0.03, 0.02, 0.02, 0.015, 0.015]),
        (tetrahedron(0.16), 4 * [math.sqrt(3.0) / 4.0 * (0.16 * math.sqrt(2.0)) ** 2]),
        (hexagonal_prism(0.08, 0.16), 2 * [1.5 * math.sqrt(3.0) * 0.08**2] + 6 * [0.08 * 0.16]),
    ],
)
def test_areas_of_faces(solid, areas):
    np.testing.assert_allclose(solid.areas, areas, rtol=1e-12)


@solids
def test_normals_are_outward_unit_vectors_perpendicular_to_their_face(solid):
    middle = solid.vertices.mean(axis=0)
    for face, normal, center in zip(solid.faces, solid.normals, solid.centers, strict=True):
        corners = solid.vertices[list(face)]
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        np.testing.assert_allclose((corners - center) @ normal, 0.0, atol=1e-15)
        assert normal @ (center - middle) > 0
        np.testing.assert_allclose(center, corners.mean(axis=0))
        # Corners run counterclockwise, seen from outside.
        turns = np.cross(np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, 0) - corners)
        assert (turns @ normal > 0).all()


@pytest.mark.parametrize("name", SOLIDS)
def test_every_edge_is_shared_by_the_two_faces_listed_for_it(name):
    solid = SOLIDS[name]
    assert len(solid.edges) == len(solid.edge_faces) == EDGES[name]
    assert len(solid.vertices) - len(solid.edges) + len(solid.faces) == 2  # Euler
    for ends, faces in zip(solid.edges, solid.edge_faces, strict=True):
        sharing = {k for k, face in enumerate(solid.faces) if set(ends) <= set(face)}
        assert sharing == set(faces) and len(sharing) == 2


def test_hues_are_taken_around_the_circle():
    box = SolidModel.box(BOX_SIZE, (-math.pi / 3, 2 * math.pi, 7.0))
    np.testing.assert_allclose(box.hues[::2], [5 * math.pi / 3, 0.0, 7.0 - 2 * math.pi])


def test_hues_and_faces_must_be_equally_many():
    box = paper_box()
    with pytest.raises(ValueError, match="6 faces need as many hues, not 5"):
        SolidModel(box.vertices, box.faces, box.hues[:5])


def test_a_solid_with_a_dent_is_none_that_is_convex():
    assert SolidModel(*box_with_a_roof(0.120), np.zeros(9)).is_convex
    dented = SolidModel(*box_with_a_roof(0.020), np.zeros(9))
    assert not dented.is_convex and not dented.is_plain
    assert len(dented.edges) == 16


def l_shape():
    outline = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]) * 0.05
    vertices = [(*p, z) for z in (0.0, 0.1) for p in outline]
    sides = [(i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i) for i in range(6)]
    return vertices, [tuple(range(5, -1, -1)), tuple(range(6, 12)), *sides]


def test_an_l_is_cut_into_triangles_that_cover_its_faces():
    vertices, faces = l_shape()
    solid = SolidModel(vertices, faces, np.zeros(8))
    assert not solid.is_convex and len(solid.edges) == 18
    corners = solid.triangles
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("tk,tk->", doubled, corners[:, 0]) / 6 == pytest.approx(3 * 0.05**2 * 0.1)
    for face in range(8):
        mine = doubled[solid.triangle_faces == face]
        np.testing.assert_allclose(mine.sum(axis=0) / 2, solid.areas[face] * solid.normals[face])
        assert (mine @ solid.normals[face] > 0).all()
    np.testing.assert_allclose(solid.areas[:2], 3 * 0.05**2)


def test_vectors_into_the_faces_at_an_edge_lie_in_them():
    solid = SolidModel(*l_shape(), np.zeros(8))
    for ends, faces, inward in zip(solid.edges, solid.edge_faces, solid.edge_inward, strict=True):
        middle = solid.vertices[ends].mean(axis=0)
        for face, into in zip(faces, inward, strict=True):
            assert abs(into @ solid.normals[face]) < 1e-12
            point = middle + 1e-3 * into
            inside = [
                all(
                    np.cross(b - a, point - a) @ solid.normals[face] > 0
                    for a, b in ((p, q), (q, r), (r, p))
                )
                for p, q, r in solid.triangles[solid.triangle_faces == face]
            ]
            assert any(inside)


def _without(face):
    box = paper_box()
    kept = [k for k in range(6) if k != face]
    return [box.vertices, [box.faces[k] for k in kept], box.hues[kept]]


def _turned(face):
    box = paper_box()
    faces = list(box.faces)
    faces[face] = faces[face][::-1]
    return [box.vertices, faces, box.hues]


def _with_a_fin():
    box = paper_box()
    a, b = box.faces[4][:2]
    return [
        np.vstack([box.vertices, [0.0, 0.0, 0.3]]),
        [*box.faces, (a, b, 8), (b, a, 8)],
        np.append(box.hues, [0.0, 0.0]),
    ]


WRONG = {
    "open": (_without(4), r"open at the edge from \(.*\) m to \(.*\) m, which has face \d alone"),
    "turned": (_turned(2), r"at the edge from .* one of them is listed clockwise.*turn it around"),
    "fin": (_with_a_fin(), r"the edge from .* has 4 faces instead of two; make parts"),
    "flat": (
        [[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2), (2, 1, 0)], [0.0, 0.0]],
        "encloses no volume",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_surface_that_encloses_no_solid_is_told_with_the_place_and_the_remedy(name):
    arguments, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        SolidModel(*arguments)


def test_a_solid_turned_inside_out_is_told():
    box = paper_box()
    with pytest.raises(ValueError, match="inside out .*clockwise.*turn all faces around"):
        SolidModel(box.vertices, [face[::-1] for face in box.faces], box.hues)


# Files


def test_the_target_s_file_is_the_paper_s_box():
    assert as_sets(SolidModel.from_mesh_file(TARGET_BOX)) == as_sets(paper_box())


def test_files_may_be_named_by_a_string():
    assert len(SolidModel.from_mesh_file(str(TARGET_BOX)).faces) == 6


@pytest.mark.parametrize("turned", TURNS)
@solids
def test_a_solid_written_to_a_file_reads_back(solid, turned, tmp_path):
    vertices = solid.vertices @ rotation(turned).T
    read = SolidModel.from_mesh_file(write_obj(tmp_path, vertices, solid.faces, colors_of(solid)))
    expected = SolidModel(vertices, solid.faces, solid.hues)
    assert as_sets(read) == as_sets(expected)
    assert len(read.edges) == len(expected.edges)


@pytest.mark.parametrize("turned", TURNS[1:])
def test_coordinates_rounded_to_a_micrometer_read_back(turned, tmp_path):
    # What modeling tools write: six digits, so corners of a turned face leave its plane a little.
    solid = hexagonal_prism()
    vertices = solid.vertices @ rotation(turned).T
    path = write_obj(tmp_path, vertices, solid.faces, colors_of(solid), digits=6)
    read = SolidModel.from_mesh_file(path)
    assert (len(read.faces), len(read.edges)) == (8, 18)


def test_neighboring_triangles_in_one_plane_merge_when_they_share_a_color(tmp_path):
    box = paper_box()
    a, b, c, d = box.faces[4]
    faces = [*box.faces[:4], (a, b, c), (a, c, d), box.faces[5]]
    colors = [(1, 0, 0)] * 2 + [(0, 1, 0)] * 2 + [(0, 0, 1)] * 3
    merged = SolidModel.from_mesh_file(write_obj(tmp_path, box.vertices, faces, colors))
    assert as_sets(merged) == as_sets(box)
    colors[4] = (1, 1, 0)
    two_colored = SolidModel.from_mesh_file(write_obj(tmp_path, box.vertices, faces, colors))
    assert (len(two_colored.faces), len(two_colored.edges)) == (7, 13)


def test_grey_materials_are_rejected(tmp_path):
    box = paper_box()
    path = write_obj(tmp_path, box.vertices, box.faces, [(1, 0, 0)] * 5 + [(0.5, 0.6, 0.55)])
    with pytest.raises(ValueError, match=r"solid\.obj.* grey"):
        SolidModel.from_mesh_file(path)


def test_meshes_without_materials_are_rejected(tmp_path):
    box = paper_box()
    path = write_obj(tmp_path, box.vertices, box.faces, colors_of(box))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if "mtl" not in line))
    with pytest.raises(ValueError, match=r"solid\.obj"):
        SolidModel.from_mesh_file(path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing_here\.obj"):
        SolidModel.from_mesh_file(tmp_path / "nothing_here.obj")


def test_a_dent_in_a_file_is_read(tmp_path):
    path = write_obj(tmp_path, *box_with_a_roof(0.020), [(1, 0, 0)] * 9)
    assert not SolidModel.from_mesh_file(path).is_convex


def test_open_meshes_in_a_file_are_rejected(tmp_path):
    box = paper_box()
    path = write_obj(tmp_path, box.vertices, box.faces[:5], colors_of(box)[:5])
    with pytest.raises(ValueError, match=r"solid\.obj: not a closed solid: open at the edge"):
        SolidModel.from_mesh_file(path)


def test_sides_that_neighbors_part_in_two_are_one_edge_each(tmp_path):
    """A quarter of the top is of another color: its neighbors' sides end where it does."""
    box = paper_box()
    x, y, z = 0.05, 0.075, 0.1
    extra = [(0, y, z), (x, 0, z), (0, 0, z), (0, -y, z), (-x, 0, z)]
    vertices = np.vstack([box.vertices, extra])
    at = {tuple(p): k for k, p in enumerate(vertices.round(6).tolist())}

    def face(*points):
        return tuple(at[p] for p in points)

    faces = [
        face((x, -y, -z), (x, y, -z), (x, y, z), (x, 0, z), (x, -y, z)),
        box.faces[1],
        face((-x, y, -z), (-x, y, z), (0, y, z), (x, y, z), (x, y, -z)),
        box.faces[3],
        face((0, 0, z), (x, 0, z), (x, y, z), (0, y, z)),
        face((-x, -y, z), (x, -y, z), (x, 0, z), (0, 0, z), (0, y, z), (-x, y, z)),
        box.faces[5],
    ]
    colors = [(1, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 0), (1, 1, 0), (0, 0, 1), (0, 0, 1)]
    solid = SolidModel.from_mesh_file(write_obj(tmp_path, vertices, faces, colors))
    assert len(solid.faces) == 7 and not solid.smooth.any()
    # The box's 12, two of which are parted, and two of the quarter's own
    assert len(solid.edges) == 16
    assert solid.areas[solid.materials.index("m4")] == pytest.approx(x * y)


def test_triangles_without_area_are_taken_in(tmp_path):
    box = paper_box()
    a, b, c, d = box.faces[4]
    middle = 0.5 * (box.vertices[a] + box.vertices[b])
    # A corner in the middle of a side that the neighbor does not have, and a sliver that fills in
    faces = [*box.faces[:4], (a, 8, d), (8, c, d), (8, b, c), (a, b, 8), box.faces[5]]
    colors = [(1, 0, 0)] * 2 + [(0, 1, 0)] * 2 + [(0, 0, 1)] * 3 + [(1, 0, 0)] + [(0, 0, 1)]
    vertices = np.vstack([box.vertices, middle])
    solid = SolidModel.from_mesh_file(write_obj(tmp_path, vertices, faces, colors))
    assert as_sets(solid) == as_sets(box)


def mug(n=32):
    """Corners and faces of a hollow body of revolution, and a number for each face's color."""
    profile = [(0, -6), (4.5, -6), (4.5, 6), (3.8, 6), (3.8, -5), (0, -5)]
    vertices, rings = [], []
    for r, z in profile:
        count = n if r else 1
        rings.append(list(range(len(vertices), len(vertices) + count)))
        angles = 2 * np.pi * np.arange(count) / n
        vertices += [(0.01 * r * np.cos(a), 0.01 * r * np.sin(a), 0.01 * z) for a in angles]
    faces, kinds = [], []
    for k, (low, high) in enumerate(itertools.pairwise(rings)):
        for i in range(n):
            j = (i + 1) % n
            quad = (low[i % len(low)], low[j % len(low)], high[j % len(high)], high[i % len(high)])
            faces.append(tuple(dict.fromkeys(quad)))
            kinds.append(k)
    return np.array(vertices), faces, np.array(kinds)


def test_curved_surfaces_are_told_from_edges(tmp_path):
    n = 32
    vertices, faces, kinds = mug(n)
    palette = [(1, 1, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)]
    path = write_obj(tmp_path, vertices, faces, [palette[k] for k in kinds])
    solid = SolidModel.from_mesh_file(path)
    # Bottom, rim and the bottom inside are plane; the walls are n facets each.
    assert len(solid.faces) == 3 + 2 * n and solid.patches.max() + 1 == 5
    assert solid.smooth.sum() == 2 * n
    assert sum(map(len, solid.holes)) == 1  # the rim's
    # All lines go on as curves: four circles, and the walls' straight lines.
    assert solid.continues.all() and len(solid.edges) == 6 * n


def colored_box():
    """The paper's box as triangles with corners of their own, and each one's color (0-255)."""
    import trimesh

    box = paper_box()
    order = np.argsort(box.triangle_faces, kind="stable")
    corners = box.triangles[order]
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    return mesh, 255 * np.repeat(np.eye(3, dtype=np.uint8)[[0, 0, 1, 1, 2, 2]], 2, axis=0)


def export(mesh, path):
    """Writes a mesh; in a glTF file y is upward, which is z everywhere else."""
    mesh = mesh.copy()
    if path.suffix == ".glb":
        x, y, z = mesh.vertices.T
        mesh.vertices = np.column_stack([x, z, -y])
    mesh.export(path)


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_colors_may_be_those_of_corners(suffix, tmp_path):
    mesh, colors = colored_box()
    mesh.visual.vertex_colors = np.repeat(colors, 3, axis=0)
    export(mesh, tmp_path / f"box.{suffix}")
    assert as_sets(SolidModel.from_mesh_file(tmp_path / f"box.{suffix}")) == as_sets(paper_box())


def test_colors_may_be_those_of_faces(tmp_path):
    mesh, colors = colored_box()
    mesh.visual.face_colors = colors
    mesh.export(tmp_path / "box.ply")
    assert as_sets(SolidModel.from_mesh_file(tmp_path / "box.ply")) == as_sets(paper_box())


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_colors_may_be_the_means_of_a_texture(suffix, tmp_path):
    import trimesh
    from PIL import Image

    mesh, colors = colored_box()
    stripes = np.repeat(np.eye(3, dtype=np.uint8)[None] * 255, 8, axis=0).repeat(8, axis=1)
    middle = (np.argmax(colors, axis=1) + 0.5) / 3.0
    offsets = np.array([(-0.1, 0.1), (0.1, 0.1), (0.0, 0.9)])
    uv = np.stack([middle[:, None] + offsets[:, 0], np.tile(offsets[:, 1], (12, 1))], axis=-1)
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=uv.reshape(-1, 2), image=Image.fromarray(stripes)
    )
    export(mesh, tmp_path / f"box.{suffix}")
    assert as_sets(SolidModel.from_mesh_file(tmp_path / f"box.{suffix}")) == as_sets(paper_box())


def test_a_mesh_without_colors_says_what_to_do(tmp_path):
    mesh, _ = colored_box()
    mesh.export(tmp_path / "box.stl")
    why = r"box\.stl: the mesh has no colors \(.* into STL files are not read\).*OBJ with MTL.*PLY"
    with pytest.raises(ValueError, match=why):
        SolidModel.from_mesh_file(tmp_path / "box.stl")
    mesh.export(tmp_path / "box.ply")
    import trimesh

    text = trimesh.exchange.obj.export_obj(mesh, include_texture=False, include_color=False)
    (tmp_path / "box.obj").write_text(f"mtllib gone.mtl\n{text}")
    with pytest.raises(ValueError, match=r"it names the materials of gone\.mtl, a file that is"):
        SolidModel.from_mesh_file(tmp_path / "box.obj")
    with pytest.raises(ValueError, match=r"box\.ply: the mesh has no colors; every.*OBJ with MTL"):
        SolidModel.from_mesh_file(tmp_path / "box.ply")


def test_what_is_no_mesh_is_told(tmp_path):
    (tmp_path / "box.ply").write_text("no mesh at all")
    with pytest.raises(ValueError, match=r"box\.ply: this is no PLY file that can be read"):
        SolidModel.from_mesh_file(tmp_path / "box.ply")
    (tmp_path / "box.doc").write_text("")
    with pytest.raises(ValueError, match=r"box\.doc: meshes are \.obj, .* files; convert"):
        SolidModel.from_mesh_file(tmp_path / "box.doc")


@pytest.mark.parametrize("colored", [True, False])
def test_a_face_with_a_corner_that_is_not_there_is_told(tmp_path, colored):
    """A byte of a binary file that has changed."""
    mesh, colors = colored_box()
    if colored:
        mesh.visual.vertex_colors = np.repeat(colors, 3, axis=0)
    mesh.export(tmp_path / "box.ply")
    content = bytearray((tmp_path / "box.ply").read_bytes())
    content[-2] = 77  # of the last face's last corner; it may be followed by a color
    content[-6] = 77
    (tmp_path / "box.ply").write_bytes(content)
    with pytest.raises(ValueError, match=r"box\.ply: a face has a corner that this PLY file lacks"):
        SolidModel.from_mesh_file(tmp_path / "box.ply")


KINDS = ["obj", "glb", "gltf", "ply", "ascii.ply", "stl", "ascii.stl"]


def write_kind(folder, kind):
    """The paper's box, each face in four, in a file of a kind; returns its path."""
    mesh, colors = colored_box()
    mesh.visual.vertex_colors = np.repeat(colors, 3, axis=0)
    mesh, path = mesh.subdivide(), folder / f"box.{kind}"
    if kind == "ascii.ply":
        mesh.export(path, encoding="ascii")
    elif kind == "ascii.stl":
        mesh.export(path, file_type="stl_ascii")
    elif kind == "gltf":
        for name, content in mesh.export(file_type="gltf").items():
            (folder / name.replace("model", "box")).write_bytes(content)
    else:
        mesh.export(path)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_an_empty_file_is_told_with_the_remedy(kind, tmp_path):
    path = tmp_path / f"box.{kind}"
    path.touch()
    message = rf"^{path}: the file is empty \(0 bytes\).*export the mesh again"
    with pytest.raises(ValueError, match=message):
        SolidModel.from_mesh_file(path)


@pytest.mark.parametrize("share", [0.02, 0.25, 0.5, 0.95])
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_was_cut_short_is_told_with_the_remedy(kind, share, tmp_path):
    path = write_kind(tmp_path, kind)
    assert len(ColoredMesh.read(path).triangles) == 48
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    suffix = "glTF" if kind == "gltf" else path.suffix[1:].upper()
    # Only the surface tells that faces are missing from an OBJ file.
    what = rf"{suffix} file|{'open at the edge' if kind == 'obj' else '$^'}"
    with pytest.raises(ValueError, match=rf"^{path}: .*({what}).*cut short") as raised:
        SolidModel.from_mesh_file(path)
    assert re.search("export .*again", str(raised.value))
    assert len(str(raised.value).splitlines()) == 1


def test_a_file_of_points_alone_holds_no_triangles(tmp_path):
    import trimesh

    trimesh.PointCloud(np.eye(3)).export(tmp_path / "points.ply")
    with pytest.raises(ValueError, match=r"points\.ply: this PLY file holds no triangles"):
        ColoredMesh.read(tmp_path / "points.ply")


def test_a_gltf_file_without_its_other_files_names_them(tmp_path):
    path = write_kind(tmp_path, "gltf")
    missing = sorted(tmp_path.glob("*.bin"))[0]
    missing.unlink()
    with pytest.raises(ValueError, match=rf"{path}: the file {missing.name} .* is missing"):
        ColoredMesh.read(path)


# Sampling


def side_distances(solid, face, normal, points):
    """Distances of points in a face's plane to its sides, positive inside: (P, sides)."""
    corners = solid.vertices[list(face)]
    sides = np.roll(corners, -1, axis=0) - corners
    inward = np.cross(normal, sides / np.linalg.norm(sides, axis=1, keepdims=True))
    return np.einsum("psk,sk->ps", points[:, None] - corners, inward)


def test_the_paper_s_box_has_340_inside_points_on_cells_of_20_mm():
    model = SearchModel(paper_box(), CELLS)
    # Faces normal to x, y, z: 8 x 10, 5 x 10 and 5 x 8 cells, twice.
    np.testing.assert_array_equal(np.diff(model.inside_start), [80, 80, 50, 50, 40, 40])
    assert len(model.inside_points) == 340
    # Edges along x, y, z, four each: 5, 8 and 10 cells.
    along = np.argmax(np.abs(model.solid.edge_directions), axis=1)
    np.testing.assert_array_equal(np.diff(model.edge_start), np.array([5, 8, 10])[along])
    assert len(model.edge_points) == 4 * (5 + 8 + 10)


def test_cells_are_equal_and_their_centers_half_a_cell_off_the_edges():
    model = SearchModel(paper_box(), CELLS)
    top = model.inside_points[model.inside_start[4] : model.inside_start[5]]
    x = -0.050 + 0.020 * (np.arange(5) + 0.5)
    y = -0.075 + 0.150 / 8 * (np.arange(8) + 0.5)
    expected = {(round(a, 9), round(b, 9), 0.1) for a in x for b in y}
    assert {tuple(p) for p in top.round(9) + 0.0} == expected


def test_margin_puts_the_outermost_points_that_far_from_the_edges():
    model = SearchModel(paper_box(), SamplingParameters(spacing=0.020, margin=0.002))
    top = model.inside_points[model.inside_start[4] : model.inside_start[5]]
    # 96 mm and 146 mm in steps of at most 20 mm: 5 and 8 of them.
    expected = {
        (round(a, 9), round(b, 9), 0.1)
        for a in np.linspace(-0.048, 0.048, 6)
        for b in np.linspace(-0.073, 0.073, 9)
    }
    assert {tuple(p) for p in top.round(9) + 0.0} == expected


@pytest.mark.parametrize("margin", [None, 0.002, 0.010, 0.030])
@pytest.mark.parametrize("spacing", [0.007, 0.020, 0.050])
@solids
def test_inside_points_lie_in_their_face_no_nearer_to_its_edges_than_the_margin(
    solid, spacing, margin
):
    model = SearchModel(solid, SamplingParameters(spacing=spacing, margin=margin))
    assert len(model.inside_start) == len(solid.faces) + 1
    assert model.inside_start[-1] == len(model.inside_points)
    for k, face in enumerate(solid.faces):
        part = slice(*model.inside_start[k : k + 2])
        points, normal = model.inside_points[part], solid.normals[k]
        assert len(points) > 0
        np.testing.assert_allclose((points - solid.centers[k]) @ normal, 0.0, atol=1e-14)
        distances = side_distances(solid, face, normal, points)
        assert distances.min() > 0
        # A face too small for the margin keeps one point in its middle.
        middle = side_distances(solid, face, normal, solid.centers[k : k + 1])
        if margin is not None and middle.min() > margin:
            assert distances.min() >= margin - 1e-8
        own = model.face_sides[slice(*model.face_sides_start[k : k + 2])]
        assert (model.sides.faces[own] == k).all() and len(own) == len(face)
        # The nearest sides come first, and of the points those that are nearest to one.
        near, sides = model.inside_distances[part, : len(face)], model.inside_sides[part]
        expected = np.take_along_axis(distances, sides[:, : len(face)], axis=1)
        np.testing.assert_allclose(near, expected, atol=1e-14)
        np.testing.assert_array_equal(near, np.sort(near, axis=1))
        np.testing.assert_array_equal(near[:, 0], np.sort(near[:, 0]))
        for row in sides[:, : len(face)]:
            assert sorted(row) == list(range(len(face)))
        assert np.isposinf(model.inside_distances[part, len(face) :]).all()
        assert len(np.unique(points.round(9), axis=0)) == len(points)


def test_a_face_too_small_for_the_margin_is_sampled_in_its_middle():
    model = SearchModel(paper_box(), SamplingParameters(margin=0.090))
    np.testing.assert_allclose(model.inside_points, paper_box().centers, atol=1e-15)


@pytest.mark.parametrize("spacing", [0.007, 0.020, 0.050])
@pytest.mark.parametrize("margin", [None, 0.002])
def test_neighbors_are_at_most_the_spacing_apart(spacing, margin):
    model = SearchModel(paper_box(), SamplingParameters(spacing=spacing, margin=margin))
    for k in range(6):
        points = model.inside_points[model.inside_start[k] : model.inside_start[k + 1]].round(9)
        for axis in range(3):
            steps = np.diff(np.unique(points[:, axis]))
            assert steps.max(initial=0.0) <= spacing + 1e-8
    for k in range(12):
        points = model.edge_points[model.edge_start[k] : model.edge_start[k + 1]]
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).max(initial=0.0) <= spacing + 1e-12


@solids
def test_edge_points_divide_their_edge_evenly(solid):
    model = SearchModel(solid, CELLS)
    assert model.edge_start[-1] == len(model.edge_points)
    for k, (a, b) in enumerate(solid.vertices[solid.edges]):
        points = model.edge_points[model.edge_start[k] : model.edge_start[k + 1]]
        length = np.linalg.norm(b - a)
        np.testing.assert_allclose(model.solid.edge_directions[k], (b - a) / length, atol=1e-14)
        shares = (np.arange(len(points)) + 0.5) / len(points)
        np.testing.assert_allclose(points, a + shares[:, None] * (b - a), atol=1e-15)
        assert len(points) == max(5, math.ceil(length / 0.020 - 1e-9))


@pytest.mark.parametrize("min_cells", [1, 4])
def test_small_edges_and_faces_have_least_numbers_of_cells(min_cells):
    small = SolidModel.box((0.01, 0.01, 0.01), (RED, GREEN, BLUE))
    sampling = SamplingParameters(spacing=0.020, min_cells=min_cells, margin=None)
    model = SearchModel(small, sampling)
    assert len(model.edge_points) == 12 * min_cells
    assert len(model.inside_points) == 6 * min_cells**2
    with pytest.raises(ValueError, match="min_cells"):
        SamplingParameters(min_cells=0)


@solids
def test_sides_are_listed_with_their_middle_and_direction(solid):
    sides = SearchModel(solid).sides
    k = 0
    for f, face in enumerate(solid.faces):
        for i, j in sides_of(face):
            a, b = solid.vertices[[i, j]]
            direction = (b - a) / np.linalg.norm(b - a)
            np.testing.assert_allclose(sides.centers[k], 0.5 * (a + b), atol=1e-15)
            np.testing.assert_allclose(sides.starts[k], a)
            np.testing.assert_allclose(sides.directions[k], direction, atol=1e-15)
            np.testing.assert_allclose(sides.inward[k], np.cross(solid.normals[f], direction))
            assert sides.faces[k] == f
            k += 1
    assert k == len(sides.faces)


def test_strip_offsets_are_passed_on():
    model = SearchModel(paper_box(), SamplingParameters(strip_offsets=(0.001, 0.004, 0.009)))
    np.testing.assert_array_equal(model.strip_offsets, [0.001, 0.004, 0.009])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spacing", 0.0),
        ("spacing", -0.02),
        ("spacing", math.nan),
        ("margin", 0.0),
        ("margin", -0.001),
        ("margin", math.nan),
        ("strip_offsets", ()),
        ("strip_offsets", (0.002, 0.0)),
        ("strip_offsets", (-0.002,)),
    ],
)
def test_lengths_must_be_positive(name, value):
    with pytest.raises(ValueError, match=name):
        SamplingParameters(**{name: value})


def test_a_mesh_as_an_obj_file_is_the_same(tmp_path):
    for name in ("mug", "hammer", "target_box"):
        mesh = ColoredMesh.read(TARGET_BOX.with_name(f"{name}.obj"))
        for file, text in zip(("it.obj", "it.mtl"), mesh.as_obj("it.mtl"), strict=True):
            (tmp_path / file).write_text(text)
        again = ColoredMesh.read(tmp_path / "it.obj")
        np.testing.assert_array_equal(again.triangles, mesh.triangles)
        np.testing.assert_array_equal(again.colors, mesh.colors)
        assert list(again.materials) == list(mesh.materials)


def test_materials_of_an_obj_file_are_words_of_one_color_each(tmp_path):
    mesh, _ = colored_box()
    colors = np.repeat(np.eye(3), 4, axis=0)
    names = 8 * ["some paint"] + 4 * ["blue"]
    text, materials = ColoredMesh("box", np.asarray(mesh.triangles), colors, names).as_obj("it.mtl")
    (tmp_path / "it.obj").write_text(text)
    (tmp_path / "it.mtl").write_text(materials)
    again = ColoredMesh.read(tmp_path / "it.obj")
    np.testing.assert_array_equal(again.colors, colors)
    assert list(dict.fromkeys(again.materials)) == ["some_paint", "some_paint_#00ff00", "blue"]


def test_corners_that_are_no_numbers_are_told(tmp_path):
    mesh, colors = colored_box()
    mesh.vertices[4] = [0.0, np.nan, 0.0]
    with pytest.raises(ValueError, match=r"^box: face 1 has corners at .*nan.* finite numbers"):
        SolidModel.from_mesh(ColoredMesh("box", mesh.triangles, colors / 255.0, 12 * ["paint"]))


def test_a_mesh_in_millimeters_is_told_by_its_name():
    mesh, colors = colored_box()
    large = ColoredMesh("box.ply", 1e3 * mesh.triangles, colors / 255.0, 12 * ["paint"])
    with pytest.raises(ValueError, match=r"^box\.ply is 200 m long.* in millimeters"):
        SearchModel(SolidModel.from_mesh(large))


def test_a_finely_divided_box_is_the_box():
    fine, _ = colored_box()
    for _ in range(4):
        fine = fine.subdivide()
    axis = np.argmax(np.abs(fine.face_normals), axis=1)
    triangles = np.asarray(fine.triangles)
    solid = SolidModel.from_triangles(triangles, paper_box().hues[2 * axis], len(axis) * ["x"])
    assert len(solid.triangles) == 12 * 4**4
    assert as_sets(solid) == as_sets(paper_box())
    assert (len(solid.vertices), len(solid.edges)) == (8, 12) and solid.is_plain
    places = [
        sorted(map(tuple, SearchModel(s).inside_points.round(9) + 0.0))
        for s in (solid, paper_box())
    ]
    assert places[0] == places[1]


def gear(teeth, radius=0.06, depth=0.006, height=0.05):
    """A gear with a cap of one hue above and below, and flanks of another one."""
    angles = 2.0 * np.pi * np.arange(4 * teeth) / (4 * teeth)
    radii = np.where((np.arange(4 * teeth) // 2) % 2 == 0, radius, radius - depth)
    ring = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    n = len(ring)
    vertices = [(*p, z) for z in (0.0, height) for p in ring]
    flanks = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    faces = [tuple(reversed(range(n))), tuple(range(n, 2 * n)), *flanks]
    return SolidModel(vertices, faces, [0.0, 0.0] + n * [2.0])


def test_of_many_small_faces_there_are_no_more_points_than_of_a_few_large_ones():
    solid = gear(100)
    model = SearchModel(solid)
    caps, flanks = np.split(np.diff(model.inside_start), [2])
    # The flanks' part is that of their area; the caps have fewer than theirs, and keep them all.
    share = solid.areas[2:].sum() / solid.areas.sum()
    assert flanks.sum() == pytest.approx(600 * share, abs=2)
    assert 30 < caps.sum() < 600 * (1.0 - share)
    assert flanks.max() <= 3 and np.ptp(np.flatnonzero(flanks)) > 0.98 * len(flanks)
    assert len(model.edge_points) <= 600
    upright = solid.edge_lengths > 0.049
    wanted = 600 * solid.edge_lengths[upright].sum() / solid.edge_lengths.sum()
    assert np.diff(model.edge_start)[upright].sum() == pytest.approx(wanted, abs=2)


def test_solids_are_equal_when_their_content_is():
    box, same = (SolidModel.box((0.1, 0.2, 0.3), (RED, GREEN, BLUE)) for _ in range(2))
    other = SolidModel.box((0.1, 0.2, 0.3), (RED, BLUE, GREEN))
    assert box == same and hash(box) == hash(same) and len({box, same, other}) == 2
    assert box != other and box != "a box"
