"""Runs the tests on every Python that mffdrake supports and that is installed here.

Usage: ``make test-all ARGS='tests/recognition -k pose'``, or
``python tools/test_all.py --pythons 3.12 3.13 -- -k pose``.

Each Python has an environment of its own, `.venv-3.x`, with the newest libraries that it can have
(among them Drake); remove it to have it made anew. What ``mffdrake doctor`` says of it comes first.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")


def main() -> int:
    """Returns 0 when the tests of all Pythons passed, 1 when one's failed or there is none."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--pythons", nargs="+", default=PYTHONS, choices=PYTHONS, metavar="3.x")
    options, pytest_options = parser.parse_known_args()
    if pytest_options[:1] == ["--"]:
        pytest_options = pytest_options[1:]
    outcomes = {version: test(version, pytest_options) for version in options.pythons}
    print("\n".join(f"Python {version}: {outcome}" for version, outcome in outcomes.items()))
    tested = [outcome for outcome in outcomes.values() if outcome != "not installed"]
    return int(not tested or any(outcome != "passed" for outcome in tested))


def test(version: str, pytest_options: list[str]) -> str:
    """Tests with one Python; returns what came of it."""
    python = find_python(version)
    if python is None:
        return "not installed"
    name = f".venv-{version}"
    environment = {**os.environ, "DEV_VENV": name}
    dev = [python, ROOT / "tools" / "dev.py"]
    # dev.py sets the environment up; pytest's own answer to --version costs nothing.
    if subprocess.run([*dev, "test", "--", "--version"], env=environment).returncode:
        return "no environment"
    for variable in ("PYTHONPATH", "PYTHONHOME"):  # as in dev.py
        environment.pop(variable, None)
    doctor = [ROOT / name / "bin" / "python", "-m", "mffdrake", "doctor"]
    if subprocess.run(doctor, cwd=ROOT, env=environment).returncode:
        return "mffdrake doctor found problems"
    tests = subprocess.run([*dev, "test", "--", *pytest_options], env=environment)
    return "failed" if tests.returncode else "passed"


def find_python(version: str) -> Path | None:
    """An interpreter of this version: on PATH, or among pyenv's."""
    on_path = shutil.which(f"python{version}")
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for python in [on_path, *sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True)]:
        # pyenv's stand-in is on PATH even where it has no such Python: try it.
        works = python and subprocess.run(
            [python, "-c", f"import sys; sys.exit('{version}' != '%d.%d' % sys.version_info[:2])"],
            capture_output=True,
        )
        if works and not works.returncode:
            return Path(python)
    return None


if __name__ == "__main__":
    sys.exit(main())
