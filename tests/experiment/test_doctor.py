"""mffdrake doctor: says what is there, what is not, and what helps."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def doctor(**variables):
    """Exit status, and the lines: name -> (mark, what was found and what helps)."""
    finished = subprocess.run(
        [sys.executable, "-m", "mffdrake", "doctor"],
        env=os.environ | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not finished.stderr
    found = re.findall(
        r"^(ok|-|BAD) +(Python|numba cache|mesh cache|\S+) +(.+(?:\n {15,}.+)?)",
        finished.stdout,
        flags=re.MULTILINE,
    )
    return finished.returncode, {name: (mark, text) for mark, name, text in found}


def test_a_machine_that_has_all_that_is_needed():
    status, found = doctor()
    assert status == 0
    assert "BAD" not in {mark for mark, _ in found.values()}
    assert {"Python", "drake", "numba", "numpy", "opencv-python-headless", "[cluster]", "graphics",
            "Graphviz", "numba cache", "mesh cache", "cores"} <= set(found)  # fmt: skip


def test_without_dot_only_pictures_of_diagrams_are_missed(tmp_path):
    status, found = doctor(PATH=str(tmp_path))
    mark, text = found["Graphviz"]
    assert (status, mark) == (0, "-")
    assert "apt-get install graphviz" in text


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_without_a_graphics_driver_the_packages_are_named(tmp_path):
    status, found = doctor(__EGL_VENDOR_LIBRARY_FILENAMES=str(tmp_path / "none.json"))
    mark, text = found["graphics"]
    assert (status, mark) == (1, "BAD")
    assert "apt-get install" in text and "--renderer flat" in text


def test_a_library_that_does_not_load_is_a_line_and_no_traceback(tmp_path):
    (tmp_path / "pydrake").mkdir()
    (tmp_path / "pydrake" / "__init__.py").write_text(
        "raise ImportError('libglib-2.0.so.0: cannot open shared object file')"
    )
    status, found = doctor(PYTHONPATH=os.pathsep.join([str(tmp_path), str(ROOT)]))
    mark, text = found["drake"]
    assert (status, mark) == (1, "BAD")
    assert "does not load" in text and "apt-get install libglib2.0-0" in text


def test_an_old_library_is_told_with_the_command_that_renews_it(tmp_path):
    info = tmp_path / "pydot-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: pydot\nVersion: 1.0\n")
    status, found = doctor(PYTHONPATH=os.pathsep.join([str(tmp_path), str(ROOT)]))
    mark, text = found["pydot"]
    assert (status, mark) == (1, "BAD")
    assert "pydot is 1.0, needed is >=3.0" in text and "pip install 'pydot>=3.0'" in text


def test_the_compiled_kernels_are_cold_in_an_empty_cache(tmp_path):
    _, found = doctor(NUMBA_CACHE_DIR=str(tmp_path))
    mark, text = found["numba cache"]
    assert mark == "-" and text.startswith(f"cold: {tmp_path}") and "mffdrake run" in text


def test_a_cache_that_cannot_be_written_to_is_told(tmp_path):
    file = tmp_path / "file"
    file.touch()
    _, found = doctor(XDG_CACHE_HOME=str(file))
    mark, text = found["mesh cache"]
    assert mark == "-" and "XDG_CACHE_HOME" in text


def test_graphviz_is_found_where_it_is():
    if shutil.which("dot") is None:
        pytest.skip("no Graphviz here")
    assert doctor()[1]["Graphviz"] == ("ok", shutil.which("dot"))
