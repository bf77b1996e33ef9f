"""The documentation site: it builds without a warning, and its reference has every public name."""

import html
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mffdrake
import mffdrake.recognition

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site's folder."""
    folder = tmp_path_factory.mktemp("site")
    finished = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert finished.returncode == 0, finished.stderr
    return folder


def text_of(path):
    return path.read_text(encoding="utf-8")


def test_every_public_name_is_in_the_reference(site):
    pages = [text_of(path) for path in (site / "reference").rglob("*.html")]
    documented = {
        name for page in pages for name in re.findall(r'id="mffdrake[\w.]*\.(\w+)"', page)
    }
    names = {*mffdrake.__all__, *mffdrake.recognition.__all__}
    assert names - documented == set()


def test_systems_have_their_port_diagrams(site):
    page = text_of(site / "reference" / "systems" / "vision.html")
    boxes = re.findall(r'<table class="ports">.*?</table>', page, flags=re.DOTALL)
    named = {re.search("<th>(.*?)</th>", box)[1]: box for box in boxes}
    assert {"MffPredictor", "OneStepGaRecognizer", "FrameRecorder"} <= set(named)
    inputs, outputs = named["MffPredictor"].split("<th>")
    assert "estimated_state" in inputs and "target_velocity <i>(optional)" in inputs
    assert "predicted_population" in outputs
    assert "pydrake_system" not in page


def test_notebooks_are_the_tutorial(site):
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        assert "jp-Notebook" in text_of(site / "notebooks" / f"{notebook.stem}.html")


def test_formulas_are_drawn(site):
    page = text_of(site / "equations.html")
    assert page.count('<svg class="formula"') > 50
    text = re.sub(r"<script.*?</script>|<[^>]*>", "", page, flags=re.DOTALL)
    assert "arithmatex" not in text and "$" not in html.unescape(text)


def test_lists_in_lists_stay_so(site):
    assert re.search(r"<li>Code:?\s*<ul>", text_of(site / "equations.html"))


def test_links_to_the_code_show_it(site):
    page = text_of(site / "equations.html")
    (link,) = set(re.findall(r'href="([^"]*pose_motion\.py\.html)"', page))
    assert "camera_motion_jacobian" in text_of(site / link)


def test_public_names_in_docstrings_are_links():
    path = ROOT / "tools" / "site" / "ports.py"
    spec = importlib.util.spec_from_file_location("ports", path)
    ports = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ports)
    where = "mffdrake.systems.timing.Timing"
    assert ports.rewritten("See `Timing` and ``Timing``.") == (
        f"See [`Timing`][{where}] and ``Timing``."
    )
