"""The notebooks run from top to bottom, and can be read so."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
REAL = ROOT.parent / "shared" / "real"
SCREEN = 40, 100  # lines, and characters in a line
LINK = re.compile(r"\]\(([^):\s]+)\)")  # to a file

of_each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def execute(notebook, folder):
    """Runs a notebook in a folder; what its cells show."""
    folder.mkdir(parents=True)
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": folder}})
    client.execute()  # Raises where a cell does.
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def texts(outputs):
    """What was printed."""
    return "".join(output.text for output in outputs if output.output_type == "stream")


def test_they_are_numbered_in_reading_order():
    assert [path.stem[:3] for path in NOTEBOOKS] == [f"{k:02d}_" for k in range(1, 8)]


@of_each
def test_runs_and_is_committed_without_outputs(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    shown = execute(notebook, tmp_path / "checkout" / "notebooks")
    assert any("image/png" in output.get("data", {}) for output in shown)
    assert not any(output.output_type == "error" for output in shown)
    assert "Traceback" not in texts(shown)  # of a command that a cell calls
    assert "mffdrake: error" not in texts(shown)


@of_each
def test_cells_fit_on_a_screen_and_each_part_is_explained(path):
    cells = nbformat.read(path, as_version=4).cells
    assert cells[0].cell_type == cells[-1].cell_type == "markdown"
    assert cells[0].source.startswith("# ")
    for cell in cells:
        if cell.cell_type == "code":
            lines = cell.source.splitlines()
            assert len(lines) <= SCREEN[0]
            assert max(map(len, lines)) <= SCREEN[1]


@of_each
def test_uses_public_names_only(path):
    code = "\n".join(
        cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"
    )
    assert "import mffdrake as mff" in code
    assert not re.search(
        r"(from|import) mffdrake\.|from mffdrake import|\bmff\._|[a-z]\._[a-z]", code
    )


@of_each
def test_links_lead_somewhere(path):
    cells = nbformat.read(path, as_version=4).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    text = re.sub(r"`[^`\n]*`", "`", text)  # In code, brackets are not links.
    assert [link for link in LINK.findall(text) if not (path.parent / link).exists()] == []


@pytest.mark.skipif(not REAL.is_dir(), reason="the real pictures are not here, see the notebook")
def test_real_images_are_taken_where_they_are(tmp_path):
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "real").symlink_to(REAL)
    notebook = nbformat.read(ROOT / "notebooks" / "06_real_images.ipynb", as_version=4)
    shown = texts(execute(notebook, tmp_path / "checkout" / "notebooks"))
    assert "no real pictures" not in shown
    distance = re.search(r"from the expected position: (\S+) mm", shown)
    assert float(distance[1]) < 10.0  # which is what the pictures' own test allows
