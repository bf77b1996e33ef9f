"""The model files are found, and the target is what its file says."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Box, Mesh, Role
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from mffdrake.systems.arms import models
from mffdrake.systems.arms.models import ConfigureParser, FindModelsPath

MODEL_FILES = ("package.xml", "pa10.urdf", "target_box.sdf", "target_box.obj", "target_box.mtl")

# Side lengths [m] along x, y, z, and the color of the two faces normal to each axis.
BOX_SIZE = (0.100, 0.150, 0.200)
FACE_COLORS = {"red": 0, "green": 1, "blue": 2}


# Where the models are.


def test_the_models_directory_holds_every_model():
    path = FindModelsPath()
    assert path.is_absolute()
    for name in MODEL_FILES:
        assert (path / name).is_file(), name


@pytest.mark.parametrize("place", ["checkout", "wheel"])
def test_models_are_found_in_a_checkout_and_in_a_wheel(place, tmp_path, monkeypatch):
    package = tmp_path / "mffdrake"
    models_path = {"checkout": tmp_path / "models", "wheel": package / "models"}[place]
    models_path.mkdir(parents=True)
    (models_path / "package.xml").touch()
    monkeypatch.setattr(models, "__file__", str(package / "systems" / "arms" / "models.py"))
    assert FindModelsPath() == models_path


def test_a_wheel_ignores_a_models_directory_beside_the_package(tmp_path, monkeypatch):
    package = tmp_path / "mffdrake"
    for models_path in (tmp_path / "models", package / "models"):
        models_path.mkdir(parents=True)
        (models_path / "package.xml").touch()
    monkeypatch.setattr(models, "__file__", str(package / "systems" / "arms" / "models.py"))
    assert FindModelsPath() == package / "models"


def test_missing_models_are_reported_with_the_places_looked_in(tmp_path, monkeypatch):
    package = tmp_path / "mffdrake"
    monkeypatch.setattr(models, "__file__", str(package / "systems" / "arms" / "models.py"))
    with pytest.raises(FileNotFoundError) as error:
        FindModelsPath()
    assert str(package / "models") in str(error.value)
    assert str(tmp_path / "models") in str(error.value)


def test_package_uris_resolve_only_after_configuring_the_parser():
    url = "package://mffdrake/target_box.sdf"
    with pytest.raises(RuntimeError, match="mffdrake"):
        Parser(MultibodyPlant(0.0)).AddModels(url=url)
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    ConfigureParser(parser)
    (target,) = parser.AddModels(url=url)
    assert plant.GetModelInstanceName(target) == "target_box"
    assert Path(parser.package_map().GetPath("mffdrake")).samefile(FindModelsPath())


def test_configuring_twice_changes_nothing():
    parser = Parser(MultibodyPlant(0.0))
    ConfigureParser(parser)
    packages = parser.package_map().GetPackageNames()
    ConfigureParser(parser)
    assert parser.package_map().GetPackageNames() == packages
    assert Path(parser.package_map().GetPath("mffdrake")).samefile(FindModelsPath())


def test_a_user_can_override_the_models(tmp_path):
    parser = Parser(MultibodyPlant(0.0))
    parser.package_map().Add("mffdrake", tmp_path)
    ConfigureParser(parser)
    assert Path(parser.package_map().GetPath("mffdrake")).samefile(tmp_path)


# The target as an image sees it.


def test_the_box_measures_100_by_150_by_200_mm_about_its_frame():
    mesh = trimesh.load(FindModelsPath() / "target_box.obj", force="mesh")
    np.testing.assert_allclose(mesh.bounds, [-0.5 * np.array(BOX_SIZE), 0.5 * np.array(BOX_SIZE)])
    # The signed volume is this only if every face is there, once, and wound outward.
    assert mesh.volume == pytest.approx(np.prod(BOX_SIZE))


def test_opposite_faces_share_a_pure_color_and_neighbors_do_not():
    scene = trimesh.load_scene(FindModelsPath() / "target_box.obj", process=False)
    assert set(scene.geometry) == set(FACE_COLORS)
    for color, axis in FACE_COLORS.items():
        faces = scene.geometry[color]
        rgba = np.zeros(4)
        rgba[[axis, 3]] = 255  # x red, y green, z blue: the axis is the channel
        np.testing.assert_array_equal(faces.visual.material.diffuse, rgba)
        both = np.zeros((2, 3))
        both[:, axis] = [-1.0, 1.0]
        normals = np.unique(faces.face_normals.round(9) + 0.0, axis=0)
        np.testing.assert_array_equal(normals, both)
        assert faces.area == pytest.approx(2.0 * np.prod(np.delete(BOX_SIZE, axis)))


def test_every_face_is_shaded_flat_by_its_own_normal():
    # Normals averaged over a corner's faces would shade, and so change the saturation of, a face.
    scene = trimesh.load_scene(FindModelsPath() / "target_box.obj", process=False)
    lines = (FindModelsPath() / "target_box.obj").read_text().splitlines()
    vertices = [np.array(line.split()[1:], float) for line in lines if line.startswith("v ")]
    normals = [np.array(line.split()[1:], float) for line in lines if line.startswith("vn ")]
    faces = [line.split()[1:] for line in lines if line.startswith("f ")]
    assert len(faces) == 6
    assert sum(len(geometry.faces) for geometry in scene.geometry.values()) == 12
    for face in faces:
        corners, face_normals = zip(
            *(
                (vertices[int(v) - 1], normals[int(n) - 1])
                for v, n in (corner.split("//") for corner in face)
            ),
            strict=True,
        )
        outward = np.mean(corners, axis=0)
        for normal in face_normals:
            np.testing.assert_allclose(normal, outward / np.linalg.norm(outward))


def test_no_face_is_shiny():
    scene = trimesh.load_scene(FindModelsPath() / "target_box.obj", process=False)
    for faces in scene.geometry.values():
        properties = faces.visual.material.kwargs
        assert properties["ks"] == [0.0, 0.0, 0.0]
        assert properties["ka"] == [0.0, 0.0, 0.0]
        assert properties["illum"] == ["1"]  # diffuse only
        assert properties["d"] == ["1"]  # opaque


# The target as Drake sees it.


@pytest.fixture(scope="module")
def target():
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    parser = Parser(plant)
    ConfigureParser(parser)
    parser.AddModels(url="package://mffdrake/target_box.sdf")
    plant.Finalize()
    return plant, scene_graph.model_inspector()


def test_the_target_is_one_free_solid_body_of_half_a_kilogram(target):
    plant, _ = target
    instance = plant.GetModelInstanceByName("target_box")
    (body,) = (plant.get_body(index) for index in plant.GetBodyIndices(instance))
    assert body.name() == "target_box"
    assert body.is_floating_base_body()
    assert body.default_mass() == 0.5
    inertia = body.default_spatial_inertia()
    np.testing.assert_allclose(inertia.get_com(), np.zeros(3), atol=1e-12)
    x, y, z = BOX_SIZE
    expected = 0.5 / 12.0 * np.diag([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    np.testing.assert_allclose(
        inertia.CalcRotationalInertia().CopyToFullMatrix3(), expected, atol=1e-10
    )


def test_the_target_is_one_mesh_to_see_and_one_box_to_touch(target):
    plant, inspector = target
    body = plant.GetBodyByName("target_box")
    frame_id = plant.GetBodyFrameIdOrThrow(body.index())
    for role in (Role.kPerception, Role.kIllustration):
        (visual,) = inspector.GetGeometries(frame_id, role)
        assert inspector.GetPoseInFrame(visual).IsExactlyEqualTo(RigidTransform())
        mesh = inspector.GetShape(visual)
        assert isinstance(mesh, Mesh)
        assert Path(mesh.source().path()).samefile(FindModelsPath() / "target_box.obj")
        np.testing.assert_array_equal(mesh.scale3(), [1.0, 1.0, 1.0])
    (collision,) = inspector.GetGeometries(frame_id, Role.kProximity)
    assert inspector.GetPoseInFrame(collision).IsExactlyEqualTo(RigidTransform())
    box = inspector.GetShape(collision)
    assert isinstance(box, Box)
    np.testing.assert_allclose(box.size(), BOX_SIZE)


def test_the_target_loads_without_the_package_uri_too(tmp_path):
    # A copy elsewhere finds its own mesh: nothing in it depends on package://mffdrake/.
    for name in ("target_box.sdf", "target_box.obj", "target_box.mtl"):
        shutil.copy(FindModelsPath() / name, tmp_path)
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    Parser(plant).AddModels(tmp_path / "target_box.sdf")
    inspector = scene_graph.model_inspector()
    meshes = [
        shape
        for shape in map(inspector.GetShape, inspector.GetAllGeometryIds(Role.kPerception))
        if isinstance(shape, Mesh)
    ]
    assert [Path(mesh.source().path()).parent for mesh in meshes] == [tmp_path]


def test_model_files_name_nothing_outside_their_directory():
    for name in MODEL_FILES:
        text = (FindModelsPath() / name).read_text()
        assert not re.search(r"\.\./|file://|/home/|/work/", text), name
