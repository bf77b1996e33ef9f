"""What the README and the pages show is true: their programs run, their files load."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from mffdrake.experiment.runs.grid import LoadGrid
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.recognition.recordings.rig_file import LoadRig

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
CALIBRATION = """
image_width: 640
image_height: 480
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [580, 0, 320, 0, 580, 240, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def blocks(language):
    """A parameter for each block of code in a language."""
    return [
        pytest.param(text, id=f"{page.relative_to(ROOT)}-{k}")
        for page in PAGES
        for k, text in enumerate(
            re.findall(
                rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.M
            )
        )
    ]


@pytest.mark.parametrize("program", blocks("python"))
def test_programs_run(program, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("text", blocks("yaml"))
def test_files_load(text, tmp_path, monkeypatch):
    file = tmp_path / "shown.yaml"
    file.write_text(text)
    if "\ngrid:" in text:
        assert LoadGrid(file).runs
    elif "calibration: " in text:
        (tmp_path / "front.yaml").write_text(CALIBRATION)
        assert LoadRig(file).names
    else:
        monkeypatch.chdir(ROOT)  # where the arm's model is looked for
        assert LoadScenario(file) != LoadScenario()


def test_there_are_programs_and_files():
    assert len(blocks("python")) >= 8
    assert len(blocks("yaml")) >= 4


def test_the_readme_is_a_front_page():
    assert len(PAGES[0].read_text(encoding="utf-8").splitlines()) <= 120


def test_few_pages_at_the_top():
    assert len([path for path in (ROOT / "docs").iterdir() if path.is_file()]) <= 8
