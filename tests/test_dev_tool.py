"""tools/dev.py, the set-up behind make: in real processes, on a small project that needs no net."""

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DEV = ROOT / "tools" / "dev.py"
OLD_PYTHON = Path.home() / ".pyenv" / "versions" / "3.8.18" / "bin" / "python"

# A project whose build needs nothing but the standard library, and takes as long as the file
# "slow" is there.
PYPROJECT = """
[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]

[project]
name = "tiny"
version = "1"
"""
BACKEND = """
import time, zipfile
from pathlib import Path

WHEEL = {
    "tiny-1.dist-info/METADATA": [
        "Metadata-Version: 2.1", "Name: tiny", "Version: 1", "Provides-Extra: dev"
    ],
    "tiny-1.dist-info/WHEEL": ["Wheel-Version: 1.0", "Root-Is-Purelib: true", "Tag: py3-none-any"],
    "tiny-1.dist-info/RECORD": [],
    "ruff.py": ["import sys", "print('ruff', *sys.argv[1:])", "sys.exit(7)"],
}

def build_editable(directory, config_settings=None, metadata_directory=None):
    Path("started").touch()
    while Path("slow").exists():
        time.sleep(0.05)
    with zipfile.ZipFile(Path(directory, "tiny-1-py3-none-any.whl"), "w") as wheel:
        for name, lines in WHEEL.items():
            wheel.writestr(name, "\\n".join(lines))
    return "tiny-1-py3-none-any.whl"
"""


@pytest.fixture
def dev():
    """The script, as a module."""
    spec = importlib.util.spec_from_file_location("dev", DEV)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def tiny_project(tmp_path):
    (tmp_path / "tools").mkdir()
    shutil.copy(DEV, tmp_path / "tools")
    (tmp_path / "pyproject.toml").write_text(PYPROJECT)
    (tmp_path / "backend.py").write_text(BACKEND)
    return tmp_path


def _run(*arguments, python=sys.executable, script=DEV, **variables):
    return subprocess.run(
        [python, script, *arguments],
        env=os.environ | variables,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("command", [["make"], ["make", "help"], [sys.executable, "tools/dev.py"]])
def test_without_a_target_each_is_told_in_a_line(dev, command):
    # Below `make test` another make would tell of its folder, too.
    variables = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    variables.pop("MFLAGS", None)
    finished = subprocess.run(
        command, cwd=ROOT, env=variables, capture_output=True, text=True, check=True
    )
    told = {line.split()[1]: line.split()[2:] for line in finished.stdout.splitlines()}
    assert set(told) == {"help", *dev.TARGETS}
    assert all(told.values())
    assert not finished.stderr


def test_make_knows_the_targets_and_no_others(dev):
    (line,) = re.findall(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert set(line.split()) == {"help", *dev.TARGETS}


def test_a_commit_is_checked_as_lint_checks(dev):
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    (local,) = config["repos"]
    hooks = [hook["entry"].removesuffix(" --force-exclude") for hook in local["hooks"]]
    # A commit's files are formatted, where lint only says which are not.
    lint = [" ".join([".venv/bin/python", *command]) for command in dev.LINT]
    assert hooks == [command.removesuffix(" --check") for command in lint]


@pytest.mark.parametrize("arguments", [["tset"], ["lint", "--", "--fix"]])
def test_wrong_usage_is_one_line_and_exit_status_2(arguments):
    finished = _run(*arguments)
    assert finished.returncode == 2
    assert len(finished.stderr.splitlines()) == 1
    assert not finished.stdout


@pytest.mark.skipif(not OLD_PYTHON.exists(), reason="no Python 3.8 here")
def test_old_python_hands_over_to_a_newer_one_or_says_what_it_needs(tmp_path):
    finished = _run("test", python=OLD_PYTHON, PATH=str(tmp_path))
    assert finished.returncode == 1
    (line,) = finished.stderr.splitlines()
    assert "needs Python 3.11 or newer" in line
    assert "is Python 3.8" in line

    (tmp_path / "python3.11").symlink_to(os.path.realpath(sys.executable))
    finished = _run("tset", python=OLD_PYTHON, PATH=str(tmp_path))
    assert finished.returncode == 2  # the newer Python looked at the target
    assert "unknown target 'tset'" in finished.stderr


def test_stamp_serves_until_something_changes(dev, tmp_path):
    root = str(tmp_path)
    pyproject = tmp_path / "pyproject.toml"
    pyproject.write_text("[project]")
    assert not dev.serves(dev.read_stamp(root), dev.describe_setup({"dev"}, root))

    dev.write_stamp(root, dev.describe_setup({"dev", "notebooks"}, root))
    stamp = dev.read_stamp(root)
    wanted = dev.describe_setup({"dev"}, root)
    assert dev.serves(stamp, wanted)
    assert not dev.serves(stamp, dev.describe_setup({"dev", "other"}, root))
    assert not dev.serves(stamp, wanted | {"python": "3.99"})
    assert not dev.serves(stamp, wanted | {"root": "/moved"})
    pyproject.write_text("[project]\n")
    assert not dev.serves(stamp, dev.describe_setup({"dev"}, root))

    Path(dev.stamp_path(root)).write_text('{"root":')
    assert dev.read_stamp(root) == {}


def test_setup_survives_an_interrupt_and_happens_once(dev, tiny_project):
    script, stamp = tiny_project / "tools" / "dev.py", tiny_project / ".venv" / "dev-stamp.json"
    (tiny_project / "slow").touch()
    process = subprocess.Popen(
        [sys.executable, script, "lint"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not (tiny_project / "started").exists():
        assert process.poll() is None
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # Ctrl-C
    (tiny_project / "slow").unlink()
    _, stderr = process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in stderr
    assert stderr.splitlines()[-1] == "dev.py: interrupted"
    assert not stamp.exists()

    finished = _run("lint", script=script)
    assert "installing .[dev]" in finished.stderr
    assert ".venv with Python" not in finished.stderr  # what there was is used
    assert stamp.exists()
    assert finished.stdout == "ruff check\n"  # the first command that fails ends it ...
    assert finished.returncode == 7  # ... and gives the exit status

    finished = _run("lint", script=script)
    assert "installing" not in finished.stderr
    assert finished.returncode == 7

    venv = tiny_project / ".venv"
    assert dev.venv_works(str(venv))
    (venv / "bin" / "python").unlink()
    (venv / "bin" / "python").symlink_to("/nonexistent/python3")
    assert not dev.venv_works(str(venv))  # as after the removal of that Python
