"""The graphics probe and RequireGraphics, in real processes with real environments."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mffdrake.systems.rendering import graphics
from mffdrake.systems.rendering.graphics import RequireGraphics

PROBE = Path(graphics.__file__).with_name("graphics_probe.py")
REQUIRE = """
from mffdrake.systems.rendering.graphics import GraphicsUnavailableError, RequireGraphics
for _ in range(2):  # a failure is not cached
    try:
        RequireGraphics()
    except GraphicsUnavailableError as error:
        print(error)
"""
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")


def _run(*command, **variables):
    return subprocess.run(
        [sys.executable, *map(str, command)],
        env=os.environ | variables,
        capture_output=True,
        text=True,
    )


def _probe(**variables):
    finished = _run("-I", "-S", PROBE, **variables)
    (line,) = finished.stdout.splitlines()
    answer = json.loads(line)
    assert finished.returncode == (0 if answer["status"] == "works" else 1)
    return answer


def _mesa_only():
    """Leaves out NVIDIA's driver, where there is one, as Mesa's variables do not reach it."""
    vendors = Path("/usr/share/glvnd/egl_vendor.d").glob("*mesa.json")
    return {"__EGL_VENDOR_LIBRARY_FILENAMES": ":".join(map(str, vendors))}


def test_probe_works_here_without_the_package():
    answer = _probe()
    assert answer["status"] == "works"
    assert answer["detail"]  # the renderer's name


def test_require_graphics_passes_here():
    RequireGraphics()


@linux_only
@pytest.mark.parametrize(
    "variable", ["__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"]
)
def test_probe_sees_that_no_driver_is_registered(variable):
    assert _probe(**{variable: "/nonexistent.json"})["status"] == "no-driver"


@linux_only
def test_probe_sees_that_the_driver_fails():
    answer = _probe(MESA_GL_VERSION_OVERRIDE="2.1", **_mesa_only())
    assert answer["status"] == "driver-fails"
    assert "gives no OpenGL 3.2 context" in answer["detail"]


@linux_only
@pytest.mark.parametrize(
    ("library", "status"), [("libglib-2.0.so.0", "no-glib"), ("libEGL.so.1", "no-libegl")]
)
def test_probe_names_the_library_that_does_not_load(tmp_path, library, status):
    (tmp_path / library).touch()
    answer = _probe(LD_LIBRARY_PATH=str(tmp_path))
    assert answer["status"] == status
    assert answer["detail"].startswith(library)


@linux_only
def test_require_graphics_names_the_problem_and_the_command():
    finished = _run("-c", REQUIRE, __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent.json")
    assert finished.returncode == 0, finished.stderr
    lines = finished.stdout.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert "no graphics driver is registered" in line
        assert "sudo apt-get install libglib2.0-0 libegl1 libgl1-mesa-dri" in line


def test_a_crash_of_the_probe_counts_as_no_driver(tmp_path):
    script = tmp_path / "crash.py"
    script.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    assert "crashes" in graphics.FindGraphicsProblem(script)
