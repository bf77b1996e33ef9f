"""The Tab key completes commands and options, as a real bash asks for them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# What bash does at a Tab key: it calls the function that `complete` names for the program.
ASK = """
eval "$(register-python-argcomplete mffdrake)"
[[ "$(complete -p mffdrake)" =~ -F\\ ([^ ]+) ]]
COMP_LINE="$1" COMP_POINT=${#1} COMP_TYPE=9
"${BASH_REMATCH[1]}" mffdrake
printf '%s\\n' "${COMPREPLY[@]}"
"""


def completed(line, folder):
    """What bash offers at the end of a line."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    finished = subprocess.run(
        ["bash", "--norc", "-c", ASK, "bash", line],
        cwd=folder, env=os.environ | {"PATH": programs}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert finished.stderr == ""
    return {word.strip() for word in finished.stdout.splitlines()}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("mffdrake re", {"record", "reproduce"}),
        ("mffdrake sweep grid.yaml --form", {"--format"}),
        ("mffdrake sweep grid.yaml --format ", {"parquet", "csv"}),
        ("mffdrake run --om", {"--omega"}),
        ("mffdrake run --scenario-file sc", {"scene.yaml"}),
    ],
)
def test_the_tab_key_completes(line, words, tmp_path):
    (tmp_path / "scene.yaml").touch()
    assert completed(line, tmp_path) == words


def test_without_a_tab_key_nothing_of_it_is_loaded():
    command = [sys.executable, "-X", "importtime", "-m", "mffdrake", "--version"]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "argparse" in finished.stderr
    assert "argcomplete" not in finished.stderr
