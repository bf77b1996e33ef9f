"""The benchmarks: their front door, and the history that they keep."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from speed.history import COLUMNS, FILE, read, record  # noqa: E402


def line(version, generation="0.5"):
    return dict.fromkeys(COLUMNS, "1") | {"version": version, "generation": generation}


# The history.


def test_what_is_recorded_is_read(tmp_path):
    file = tmp_path / "history.csv"
    assert read(file) == []
    lines = [line("0.1.0"), line("0.2.0", "0.4")]
    for one in lines:
        record(one, file)
    assert read(file) == lines
    assert file.read_text().splitlines()[0] == ",".join(COLUMNS)


def test_a_line_takes_the_place_of_that_of_the_same_version(tmp_path):
    file = tmp_path / "history.csv"
    for version in ("0.1.0", "0.2.0", "0.3.0"):
        record(line(version), file)
    record(line("0.2.0", "0.3"), file)
    assert [(one["version"], one["generation"]) for one in read(file)] == [
        ("0.1.0", "0.5"), ("0.2.0", "0.3"), ("0.3.0", "0.5"),
    ]  # fmt: skip


def test_columns_stand_in_their_order_whatever_a_lines_order_is(tmp_path):
    file = tmp_path / "history.csv"
    record({name: f"its {name}" for name in reversed(COLUMNS)}, file)
    assert file.read_text() == f"{','.join(COLUMNS)}\n{','.join(f'its {n}' for n in COLUMNS)}\n"


def test_a_line_with_other_columns_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "history.csv"
    record(line("0.1.0"), file)
    before = file.read_bytes()
    for wrong in (line("0.2.0") | {"more": "1"}, {"version": "0.2.0"}):
        with pytest.raises(ValueError, match="a line has version, date"):
            record(wrong, file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_a_line_that_cannot_be_written_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "history.csv"
    record(line("0.1.0"), file)
    before = file.read_bytes()
    with pytest.raises(UnicodeEncodeError):
        record(line("\ud800"), file)  # half of a character: it breaks while the file is written
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_the_history_that_is_kept_has_ratios():
    kept = read(FILE)
    assert kept
    for one in kept:
        assert tuple(one) == COLUMNS
        assert all(float(one[name]) > 0.0 for name in COLUMNS[COLUMNS.index("reference_ms") :])


# The front door.


def run(*arguments):
    return subprocess.run(
        [sys.executable, str(ROOT / "benchmarks"), *arguments],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_without_a_name_the_studies_are_told():
    finished = run()
    assert finished.returncode == 0
    _, _, *told = finished.stdout.splitlines()
    names = {line.split()[0] for line in told}
    pages = {path.stem for path in (ROOT / "docs" / "studies").glob("*.md")}
    assert names == pages | {"kills", "scale"}  # which need no page


def test_an_unknown_name_is_an_error():
    finished = run("acuracy")
    assert finished.returncode == 2
    assert "accuracy" in finished.stdout


@pytest.mark.parametrize(
    "study",
    ["accuracy", "real_images", "acquisition", "targets", "confidence", "robustness", "servoing",
     "performance", "kills", "scale"],
)  # fmt: skip
def test_each_study_tells_its_options(study):
    finished = run(study, "--help")
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.startswith(f"usage: benchmarks {study}")


def test_a_few_of_the_many_runs_on_a_cluster():
    finished = run("scale", "--runs", "12", "--workers", "1")
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.splitlines()[-1] == "12 of 12 runs are in the table of results."
