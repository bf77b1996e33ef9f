"""The command ``target``: what the recognizer makes of a mesh."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mffdrake.experiment.commands.main import main

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


def test_hues_that_overlap_are_told(tmp_path, capsys):
    mesh = tmp_path / "target_box.obj"
    mesh.write_text((MODELS / "target_box.obj").read_text())
    paint = (MODELS / "target_box.mtl").read_text().replace("Kd 0 1 0", "Kd 1 0.2 0")
    (tmp_path / "target_box.mtl").write_text(paint)
    numbers, text = told(mesh, tmp_path, capsys)
    pattern = "the hues of (red and green|green and red) overlap"
    assert any(re.search(pattern, one) for one in numbers["warnings"])
    assert re.search(f"Warning: {pattern}", text)


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
