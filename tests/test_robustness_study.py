"""The robustness study, on a tiny plan: its page says what its rows say."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
CONDITIONS = ["none", "black-images-0.2-s"]
PLAN = ["--seeds", "1", "--duration", "0.2", "--workers", "1", "--only", *CONDITIONS]


def study(folder, *arguments):
    program = [sys.executable, str(ROOT / "benchmarks" / "robustness.py")]
    where = ["--out", str(folder / "out"), "--docs", str(folder / "docs")]
    return subprocess.run(
        [*program, *where, *arguments], capture_output=True, text=True, cwd=ROOT, check=False
    )


def read_rows(folder):
    with (folder / "out" / "rows.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def tables(page):
    """Title of a section -> its table's lines, as mappings."""
    found, title, header = {}, None, None
    for line in page.splitlines():
        if line.startswith("## "):
            title, header = line[3:], None
        elif line.startswith("|"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if header is None:
                header = cells
                found[title] = []
            elif set(line) - set("|-:"):
                found[title].append(dict(zip(header, cells, strict=True)))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    finished = study(folder, *PLAN)
    assert finished.returncode == 0, finished.stderr
    return folder


def test_every_condition_is_run_for_both_motions_and_methods(folder):
    rows = read_rows(folder)
    assert {row["status"] for row in rows} == {"done"}
    assert {row["seed"] for row in rows} == {"1000"}
    kinds = [(row["group"], row["motion"], row["method"]) for row in rows]
    assert sorted(kinds) == sorted(
        (group, motion, method)
        for group in ("none", "black images")
        for motion in ("path", "shaking")
        for method in ("ga", "mff")
    )


def test_the_tables_say_what_the_rows_say(folder):
    rows = read_rows(folder)
    found = tables((folder / "docs" / "robustness.md").read_text(encoding="utf-8"))
    assert set(found) == {"In all", "None", "Black images"}
    assert len(found["None"]) == 4 and len(found["Black images"]) == 8
    for row in rows:
        # The undisturbed lines stand in the other tables too.
        titles = ["None", "Black images"] if row["group"] == "none" else ["Black images"]
        for title in titles:
            strength = {"None": "-", "Black images": "none"}[title]
            strength = strength if row["group"] == "none" else "0.2 s"
            given = (row["motion"], strength, row["method"])
            (line,) = (
                line
                for line in found[title]
                if (line["motion"], line["strength"], line["method"]) == given
            )
            for name, column in (
                ("right", "right"), ("says_so", "tracking"), ("false", "false"),
                ("missed", "missed"),
            ):  # fmt: skip
                shown = float(line[column].removesuffix("%"))
                assert shown == pytest.approx(100 * float(row[f"tracking.{name}"]), abs=0.01)
            error = row["rms_tracked.position_mm"]
            shown = line["tracked position [mm]"]
            assert shown == (f"{float(error):.2f}" if error else "-")


def test_the_totals_count_frames(folder):
    rows = read_rows(folder)
    page = (folder / "docs" / "robustness.md").read_text(encoding="utf-8")
    lines = tables(page)["In all"]
    assert len(lines) == 5
    for line in lines:
        members = [
            row
            for row in rows
            if line["motion"] in (row["motion"], "both")
            and line["method"] in (row["method"], "both")
        ]
        frames = np.array([int(row["frames"]) for row in members])
        assert int(line["frames"]) == frames.sum() > 0
        for name in ("right", "false", "missed"):
            shares = np.array([float(row[f"tracking.{name}"]) for row in members])
            assert int(line[name].split()[0]) == round(float(shares @ frames))


def test_the_page_shows_the_picture(folder):
    page = (folder / "docs" / "robustness.md").read_text(encoding="utf-8")
    assert "(images/robustness.png)" in page
    picture = (folder / "docs" / "images" / "robustness.png").read_bytes()
    assert picture.startswith(b"\x89PNG")


def test_the_same_command_repeats_no_run(folder):
    before = read_rows(folder)
    finished = study(folder, *PLAN)
    assert finished.returncode == 0, finished.stderr
    assert read_rows(folder) == before  # With the very wall times.


def test_an_unknown_condition_is_refused_in_one_line(tmp_path):
    finished = study(tmp_path, "--only", "snow")
    assert finished.returncode == 1
    (line,) = finished.stderr.splitlines()
    assert "'snow'" in line and "noise" in line
    assert not (tmp_path / "out").exists()
