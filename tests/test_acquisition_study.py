"""The acquisition study, on a few poses: what it draws, and what its table says."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from acquisition.cases import SOLIDS, Case, Renderer, disturb  # noqa: E402

from mffdrake.recognition import Matcher, SearchModel  # noqa: E402


@pytest.mark.parametrize("solid", SOLIDS)
def test_solids_are_drawn_where_the_pose_has_them(solid):
    case, rng = Case(name=solid, solid=solid), np.random.default_rng(1)
    draw = Renderer(case, "flat")
    matcher = Matcher(SearchModel(SOLIDS[solid]), case.rig)
    for _ in range(3):
        pose = case.draw_pose(rng)
        assert matcher.fitness([pose], draw(pose))[0] > 0.98


def test_a_bar_hides_the_share_that_the_case_wants():
    plain, hidden = Case(name="plain"), Case(name="hidden", hidden=0.4)
    draw = Renderer(plain, "flat")
    for seed in range(3):
        pictures = draw(plain.draw_pose(np.random.default_rng(seed)))
        shown = [np.ptp(image, axis=2) > 25 for image in pictures]
        for image, picture, mask in zip(
            disturb(pictures, hidden, [seed], 0), pictures, shown, strict=True
        ):
            covered = (image != picture).any(axis=2) & mask
            assert covered.sum() / mask.sum() == pytest.approx(0.4, abs=0.02)


def test_blobs_lie_behind_the_solid_and_noise_is_that_of_its_frame():
    case = Case(name="both", blobs=10, noise=5.0)
    plain = Case(name="blobs", blobs=10)
    pictures = Renderer(case, "flat")(case.draw_pose(np.random.default_rng(5)))
    blobs = disturb(pictures, plain, [5], 0)
    for image, picture in zip(blobs, pictures, strict=True):
        mask = np.ptp(picture, axis=2) > 25
        np.testing.assert_array_equal(image[mask], picture[mask])
        assert (np.ptp(image, axis=2) > 25).sum() > mask.sum() + 500
    first, again, second = (disturb(pictures, case, [5], k)[0].astype(int) for k in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    grey = (blobs[0] == 128).all(axis=2)
    assert (first - 128)[grey].std() == pytest.approx(5.0, rel=0.05)
    assert (first - second)[grey].std() == pytest.approx(5.0 * np.sqrt(2.0), rel=0.05)


def test_its_table_has_a_row_a_case_and_finds_the_box(tmp_path):
    program = [sys.executable, str(ROOT / "benchmarks"), "acquisition", "--poses", "3"]
    few = ["--renderers", "flat", "--motions", "rest", "--only", "box", "box, 10 blobs"]
    finished = subprocess.run(
        [*program, *few, "--docs", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert finished.returncode == 0, finished.stderr
    assert "| box | 100.0 | 100.0 | 100.0 | - | 100.0 | 0.0 |" in finished.stdout
    assert "| box, 10 blobs | 100.0 |" in finished.stdout
    assert not list(tmp_path.iterdir())  # A part of the cases is no page.
