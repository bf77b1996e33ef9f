"""What the README shows is true."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("k", range(len(PROGRAMS)))
def test_programs_run(k, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAMS[k]],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_there_are_programs():
    assert len(PROGRAMS) == 5
