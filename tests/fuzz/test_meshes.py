"""Mesh files of any bytes and solids of any shape: what is read can be searched for, or one line
tells what is wrong with it."""

import functools

import numpy as np
from hypothesis import strategies as st
from judging import NUMBERS, ROOT, mutated, outcome, prop

import mffdrake as mff
from mffdrake.recognition import BLUE, GREEN, RED

MODELS = ROOT / "models"
WORDS = st.sampled_from(
    ["nan", "inf", "-inf", "1e308", "1e-320", "0", "-1", "1e9", "f", "v", "vn", "vt", "usemtl x",
     "newmtl x", "Kd 1 0 0", "f 1 1 1", "f 1 2 9999", "f -1 -2 -3", "f 0 1 2", "v 0 0 0", "\0",
     "property float x", "property list uchar int a", "element face 99999", "element vertex 3",
     "format binary_little_endian 1.0", "format ascii 1.0", "end_header", "mtllib no.mtl"]
)  # fmt: skip


@functools.cache
def exported(kind):
    """Files' contents of one kind, each of a colored mesh."""
    if kind == "obj":
        return [
            (MODELS / f"{name}.obj").read_text(encoding="utf-8")
            for name in ("target_box", "wedge", "l_block", "notched_box")
        ]
    import trimesh

    made = []
    for name in ("target_box", "wedge"):
        mesh = mff.ColoredMesh.read(MODELS / f"{name}.obj")
        part = trimesh.Trimesh(
            mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.triangles)).reshape(-1, 3),
            vertex_colors=np.repeat(np.rint(255 * mesh.colors), 3, axis=0).astype(np.uint8),
            process=False,
        )  # fmt: skip
        if kind == "glb" and name == "wedge":
            red = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
            part.visual = trimesh.visual.TextureVisuals(material=red)
        made.append(part.export(file_type=kind))
        if kind == "ply":
            made.append(part.export(file_type=kind, encoding="ascii"))
    return [data.encode() if isinstance(data, str) else data for data in made]


def check_solid(solid):
    """All that a solid tells is finite, and it can be sampled and matched, or it is refused."""
    for name in ("vertices", "normals", "areas", "centers", "edge_lengths", "edge_directions"):
        assert np.isfinite(getattr(solid, name)).all(), name
    assert np.isfinite(solid.size).all()
    model = outcome(mff.SearchModel, solid, error=ValueError)
    if model is None or len(solid.faces) > 60:
        return
    assert np.isfinite(model.inside_points).all() and np.isfinite(model.edge_points).all()
    matcher = mff.Matcher(model, mff.CameraRig.stereo(width=64, height=48))
    image = np.full((48, 64, 3), (255, 0, 0), dtype=np.uint8)
    poses = [[0, 0, 0.8, 0, 0, 0], [0, 0.1, 0.5, 0.3, 0.4, 0.5], [0, 0, 0, 0, 0, 0]]
    fitness = matcher.fitness(poses, [image, image])
    assert ((fitness >= 0.0) & (fitness <= 1.0)).all(), fitness


def check_file(file):
    """A mesh file is read to finite numbers, or refused with a line that names it."""
    mesh = outcome(mff.ColoredMesh.read, file, error=ValueError)
    if mesh is not None:
        solid = outcome(mff.SolidModel.from_mesh, mesh, error=ValueError)
        if solid is not None:
            check_solid(solid)


@prop(mutated(exported("obj"), WORDS), share=0.5)
def test_any_damaged_obj_is_taken_or_told(tmp_path_factory, text):
    folder = tmp_path_factory.getbasetemp()
    for name in ("target_box", "wedge", "l_block", "notched_box"):
        (folder / f"{name}.mtl").write_bytes((MODELS / f"{name}.mtl").read_bytes())
    file = folder / "damaged.obj"
    file.write_bytes(text.encode(errors="replace"))
    check_file(file)


@prop(mutated([(MODELS / "wedge.mtl").read_text(encoding="utf-8")], WORDS), share=0.5)
def test_any_damaged_mtl_is_taken_or_told(tmp_path_factory, text):
    folder = tmp_path_factory.mktemp("mtl", numbered=True)
    (folder / "wedge.obj").write_bytes((MODELS / "wedge.obj").read_bytes())
    (folder / "wedge.mtl").write_bytes(text.encode(errors="replace"))
    check_file(folder / "wedge.obj")


@prop(
    st.sampled_from(["ply", "stl", "glb"]).flatmap(
        lambda kind: st.tuples(st.just(kind), mutated(exported(kind)))
    ),
    share=0.5,
)
def test_any_damaged_binary_file_is_taken_or_told(tmp_path_factory, case):
    kind, data = case
    file = tmp_path_factory.getbasetemp() / f"damaged.{kind}"
    file.write_bytes(data)
    check_file(file)


@prop(st.sampled_from(["obj", "ply", "stl", "glb", "gltf", "txt"]), st.binary(max_size=200))
def test_any_bytes_are_told(tmp_path_factory, kind, data):
    file = tmp_path_factory.getbasetemp() / f"any.{kind}"
    file.write_bytes(data)
    assert outcome(mff.ColoredMesh.read, file, error=ValueError) is None


BOX = mff.SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))


@st.composite
def solids(draw):
    """Triangles, hues and materials of a box, or two, with a few corners and faces gone wrong."""
    triangles = np.array(BOX.triangles)
    hues = np.array(BOX.hues)[BOX.triangle_faces]
    if draw(st.booleans()):  # another part, apart or overlapping
        shift = draw(st.sampled_from([0.0, 1e-9, 0.05, 0.1, 0.3, 1e6]))
        triangles = np.concatenate([triangles, triangles * draw(NUMBERS) + shift])
        hues = np.tile(hues, 2)
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3)
    for _ in range(draw(st.integers(0, 4))):
        k, axis = draw(st.integers(0, len(corners) - 1)), draw(st.integers(0, 2))
        kind = draw(st.sampled_from(["move", "near", "onto", "cut", "flip", "double", "point"]))
        face = draw(st.integers(0, len(index) - 1))
        if kind == "move":
            corners[k, axis] = draw(NUMBERS)
        elif kind == "near":
            corners[k, axis] += draw(st.sampled_from([1e-17, 1e-12, 1e-9, 1e-6, 1e-3, 0.05]))
        elif kind == "onto":
            corners[k] = corners[draw(st.integers(0, len(corners) - 1))]
        elif kind == "cut" and len(index) > 1:
            index, hues = np.delete(index, face, 0), np.delete(hues, face)
        elif kind == "flip":
            index[face] = index[face][::-1]
        elif kind == "double":
            index, hues = np.vstack([index, index[face]]), np.append(hues, hues[face])
        elif kind == "point":
            index[face, axis] = index[face, (axis + 1) % 3]
    scale = draw(st.sampled_from([1.0, 1.0, 1.0, 1e-3, 1e-9, 1e-160, 1e3, 1e9, 1e160]))
    if draw(st.integers(0, 9)) == 0:
        hues = hues * draw(NUMBERS)
    with np.errstate(all="ignore"):
        return corners[index] * scale, hues, [f"{hue:.3g}" for hue in hues]


@prop(solids())
def test_any_solid_is_taken_or_told(solid):
    made = outcome(mff.SolidModel.from_triangles, *solid, error=ValueError)
    if made is not None:
        check_solid(made)


@prop(
    st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=0, max_size=8),
    st.lists(st.lists(st.integers(-2, 9), max_size=5), max_size=8),
    st.lists(NUMBERS, max_size=8),
)
def test_any_corners_and_faces_are_taken_or_told(corners, faces, hues):
    hues = [*hues, *[0.0] * len(faces)][: len(faces)]
    made = outcome(mff.SolidModel, corners, faces, hues, error=ValueError)
    if made is not None:
        check_solid(made)


@prop(st.lists(NUMBERS, min_size=3, max_size=3), st.lists(NUMBERS, min_size=3, max_size=3))
def test_any_box_is_taken_or_told(size, hues):
    made = outcome(mff.SolidModel.box, size, hues, error=ValueError)
    if made is not None:
        check_solid(made)
