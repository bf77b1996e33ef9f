"""The command ``target``: what the recognizer makes of a mesh."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mffdrake.experiment.commands.main import main
from mffdrake.recognition import SearchModel, SolidModel
from mffdrake.recognition.fitness.advice import describe_target

MODELS = Path(__file__).parents[2] / "models"


def told(mesh, tmp_path, capsys):
    assert main(["target", str(mesh), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "target.png").stat().st_size > 10_000
    return json.loads((tmp_path / "out" / "target.json").read_text()), capsys.readouterr().out


def test_it_tells_sizes_colors_and_symmetries(tmp_path, capsys):
    numbers, text = told(MODELS / "mug.obj", tmp_path, capsys)
    np.testing.assert_allclose(numbers["size_m"], [0.09, 0.09, 0.12])
    assert numbers["triangles"] == 480 and not numbers["convex"]
    assert numbers["curved_surfaces"] == 3 and numbers["warnings"] == []
    hues = {color["name"]: round(color["hue_deg"]) for color in numbers["colors"]}
    assert hues == {"red": 0, "yellow": 60, "green": 120, "cyan": 180, "blue": 240, "magenta": 300}
    assert "any turn about" in numbers["symmetries"] and "any turn about" in text


@pytest.mark.parametrize(
    ("change", "warning"),
    [
        (lambda text: scaled(text, 20.0), "4 m long.*millimeters"),
        (lambda text: scaled(text, 0.01), "other units"),
        (lambda text: scaled(text, 0.05), "pixels wide"),
    ],
    ids=["large", "too small", "small faces"],
)
def test_it_warns_of_what_makes_recognition_hard(change, warning, tmp_path, capsys):
    mesh = tmp_path / "target_box.obj"
    mesh.write_text(change((MODELS / "target_box.obj").read_text()))
    (tmp_path / "target_box.mtl").write_text((MODELS / "target_box.mtl").read_text())
    numbers, _ = told(mesh, tmp_path, capsys)
    assert any(re.search(warning, one) for one in numbers["warnings"])


def scaled(text, factor):
    """An OBJ file's text, its vertices farther apart."""
    lines = []
    for line in text.splitlines():
        kind, *numbers = line.split() or [""]
        if kind == "v":
            line = " ".join(["v", *(f"{factor * float(x):.9g}" for x in numbers)])
        lines.append(line)
    return "\n".join(lines) + "\n"


def recolored(name, tmp_path, **paints):
    """One of the models with other colors of some materials: red, green, blue from 0 to 1."""
    (tmp_path / f"{name}.obj").write_text((MODELS / f"{name}.obj").read_text())
    materials = (MODELS / f"{name}.mtl").read_text()
    for material, paint in paints.items():
        materials = re.sub(rf"(newmtl {material}\n(?:.*\n)*?)Kd .*", rf"\1Kd {paint}", materials)
    (tmp_path / f"{name}.mtl").write_text(materials)
    return tmp_path / f"{name}.obj"


def test_neighbors_of_nearly_one_hue_are_told_once(tmp_path, capsys):
    """The green faces and the red ones of the box share four edges of its longest side."""
    mesh = recolored("target_box", tmp_path, green="0.4 0.08 0")  # 12 deg from red, and darker
    numbers, text = told(mesh, tmp_path, capsys)
    (warning,) = numbers["warnings"]
    red, green = r"red \(hue 0 deg\)", r"green \(hue 12 deg\)"
    assert re.match(
        rf"neighboring faces of nearly one hue: ({red} and {green}|{green} and {red}), "
        r"12 deg apart, along \d+ mm; ",
        warning,
    )
    assert "hue alone" in warning and "more than 40 deg apart" in warning
    assert f"Warning: {warning}\n" in text


def test_a_darker_shade_beside_a_color_is_nearly_one_hue(tmp_path, capsys):
    (warning,) = told(recolored("target_box", tmp_path, green="0.5 0 0"), tmp_path, capsys)[0][
        "warnings"
    ]
    assert ", 0 deg apart, along " in warning


def test_hues_around_the_circle_are_near(tmp_path, capsys):
    mesh = recolored("target_box", tmp_path, green="1 0 0.5")  # 330 deg
    (warning,) = told(mesh, tmp_path, capsys)[0]["warnings"]
    assert "(hue 330 deg)" in warning and ", 30 deg apart" in warning


def test_many_pairs_of_colors_are_one_warning(tmp_path, capsys):
    names = ("red", "yellow", "green", "cyan", "blue", "magenta")
    paints = {name: f"1 {0.05 * k:.2f} 0" for k, name in enumerate(names)}
    numbers, _ = told(recolored("mug", tmp_path, **paints), tmp_path, capsys)
    (warning,) = [one for one in numbers["warnings"] if "neighboring" in one]
    assert warning.count(" apart, along ") == 3 and re.search(r", and \d+ more pairs; ", warning)
    assert len(numbers["warnings"]) <= 2


def test_like_colors_of_faces_that_do_not_touch_may_be_taken_for_each_other(tmp_path, capsys):
    """The top and the bottom of a box of five colors."""
    size, paint = (0.1, 0.15, 0.2), {2: (255, 0, 0), -2: (255, 60, 0)}
    box = trimesh.creation.box(size)
    sides = np.rint(box.face_normals).astype(int) @ [1, 3, 2]
    others = {1: (0, 255, 0), -1: (0, 0, 255), 3: (0, 255, 255), -3: (255, 0, 255)}
    box.visual.face_colors = [(paint | others)[side] for side in sides]
    box.export(tmp_path / "box.ply")
    (warning,) = told(tmp_path / "box.ply", tmp_path, capsys)[0]["warnings"]
    assert re.match(r"colors of nearly one hue: #\w+ .* and #\w+ .*, 14 deg apart; ", warning)
    assert "taken for each other" in warning


@pytest.mark.parametrize("model", sorted(MODELS.glob("*.obj")), ids=lambda path: path.stem)
def test_the_models_have_hues_that_are_told_apart(model):
    warnings = describe_target(SearchModel(SolidModel.from_mesh_file(model)))["warnings"]
    assert [one for one in warnings if "hue" in one] == []


def test_a_mesh_that_encloses_nothing_ends_with_one_line(tmp_path, capsys):
    mesh = tmp_path / "target_box.obj"
    lines = (MODELS / "target_box.obj").read_text().splitlines()
    last = max(k for k, line in enumerate(lines) if line.startswith("f "))
    mesh.write_text("\n".join(lines[:last]) + "\n")
    (tmp_path / "target_box.mtl").write_text((MODELS / "target_box.mtl").read_text())
    assert main(["target", str(mesh), "--out", str(tmp_path / "out")]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and "open at the edge from" in errors[0]
    assert not (tmp_path / "out").exists()


def test_a_mesh_in_millimeters_ends_with_one_line(tmp_path, capsys):
    mesh = tmp_path / "target_box.obj"
    mesh.write_text(scaled((MODELS / "target_box.obj").read_text(), 1000.0))
    (tmp_path / "target_box.mtl").write_text((MODELS / "target_box.mtl").read_text())
    assert main(["target", str(mesh), "--out", str(tmp_path / "out")]) == 2
    assert "200 m long, too large" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("share", "message"),
    [(0.0, "box.glb: the file is empty"), (0.5, "box.glb: this is no GLB file")],
)
def test_an_export_that_failed_ends_with_one_line(share, message, tmp_path, capsys):
    mesh = tmp_path / "box.glb"
    trimesh.creation.box((0.1, 0.15, 0.2)).export(mesh)
    content = mesh.read_bytes()
    mesh.write_bytes(content[: int(share * len(content))])
    assert main(["target", str(mesh), "--out", str(tmp_path / "out")]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and message in errors[0] and "export the mesh again" in errors[0]
    assert not (tmp_path / "out").exists()
