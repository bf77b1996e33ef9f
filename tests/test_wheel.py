"""The wheel carries the models: installed elsewhere, it loads the arm and the target."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]

MODEL_FILES = ("package.xml", "pa10.urdf", "target_box.sdf", "target_box.obj", "target_box.mtl")

# Run by the new environment's Python, which prints where it found things.
LOAD_THE_MODELS = """
import mffdrake
print(mffdrake.__file__)
print(mffdrake.MakePa10Plant.__name__)
from mffdrake.recognition import Camera
print(Camera.__name__)

from pydrake.geometry import Mesh, Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from mffdrake.systems.arms.models import ConfigureParser, FindModelsPath
from mffdrake.systems.arms.pa10 import AddPa10
print(FindModelsPath())

plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.0)
arm = AddPa10(plant)
parser = Parser(plant)
ConfigureParser(parser)
(target,) = parser.AddModels(url="package://mffdrake/target_box.sdf")
plant.Finalize()
print(plant.GetModelInstanceName(arm), plant.num_positions(arm))
print(plant.GetModelInstanceName(target), plant.num_positions(target))

inspector = scene_graph.model_inspector()
shapes = [inspector.GetShape(i) for i in inspector.GetAllGeometryIds(Role.kPerception)]
print(*[shape.source().path() for shape in shapes if isinstance(shape, Mesh)])
"""


def run(*command: str | Path, cwd: Path) -> str:
    """Runs a command without this environment's Python settings; returns what it prints."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    result = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, f"{command}\n{result.stdout}\n{result.stderr}"
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from this checkout."""
    out = tmp_path_factory.mktemp("dist")
    # With the build backend at hand, no environment needs to be made (and downloaded) for it.
    options = ["--no-isolation"] if importlib.util.find_spec("hatchling") else []
    run(
        *(sys.executable, "-m", "build", "--wheel", *options, "--outdir", out, REPOSITORY),
        cwd=out,
    )
    (path,) = out.glob("mffdrake-*.whl")
    return path


def test_the_wheel_holds_the_package_and_the_models_once(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert len(names) == len(set(names))
    assert {f"mffdrake/models/{name}" for name in MODEL_FILES} <= set(names)
    assert {"mffdrake/__init__.py", "mffdrake/py.typed"} <= set(names)
    # The public names are read from them when the package is imported.
    assert {"mffdrake/__init__.pyi", "mffdrake/recognition/__init__.pyi"} <= set(names)
    # Nothing lands beside the package in site-packages.
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"mffdrake"}


def test_an_installed_wheel_loads_the_arm_and_the_target_from_anywhere(wheel, tmp_path):
    environment = tmp_path / "environment"
    venv.create(environment)
    python = environment / "bin" / "python"
    run(
        *(sys.executable, "-m", "pip", "--python", python),
        *("install", "--quiet", "--no-deps", "--no-index", wheel),
        cwd=tmp_path,
    )
    # The dependencies come from the environment of this test. Python reads no .pth files in a
    # directory named by one, so the editable install of mffdrake there stays out of reach.
    site_packages = Path(sysconfig.get_path("purelib", vars={"base": str(environment)}))
    assert (site_packages / "mffdrake").is_dir()
    (site_packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")

    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    lines = run(python, "-c", LOAD_THE_MODELS, cwd=elsewhere).splitlines()

    package, function, camera, models, arm, target, mesh = lines
    assert Path(package) == site_packages / "mffdrake" / "__init__.py"
    assert (function, camera) == ("MakePa10Plant", "Camera")
    assert Path(models) == site_packages / "mffdrake" / "models"
    assert arm == "pa10 7"
    assert target == "target_box 7"
    assert Path(mesh) == Path(models) / "target_box.obj"
