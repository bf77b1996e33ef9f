"""The paper's numbers, and verdicts and ratios on numbers made by hand."""

import numpy as np
import pytest

from mffdrake.experiment.paper.paper_numbers import (
    CELLS,
    PAPER,
    InvarianceRatio,
    ReachesPaper,
    Verdict,
)
from mffdrake.experiment.runs.table import Quartiles


def test_the_papers_columns_are_complete():
    assert set(PAPER) == {(m, w) for m in ("ga", "mff") for w in (0.105, 0.157, 0.314)}
    for column in PAPER.values():
        assert list(column) == [*CELLS, "position_mm", "rotation_deg"]
        assert min(column.values()) > 0


def test_distance_and_angle_follow_from_the_papers_components():
    column = PAPER["ga", 0.314]
    assert column["position_mm"] == pytest.approx(
        np.linalg.norm([7.6398, 21.7151, 33.8106]), rel=1e-12
    )
    assert column["rotation_deg"] == pytest.approx(9.48, abs=0.01)


@pytest.mark.parametrize(
    ("cell", "ours", "paper", "expected"),
    [
        ("z_mm", 2.0, 2.0, "ok"),
        ("z_mm", 1.9, 2.0, "ok"),
        ("z_mm", 5.0, 2.0, "x2.5"),
        ("z_mm", 2.01, 2.0, "x1.005"),  # Not "x1.0", which would look equal.
        ("mean_fitness", 0.98, 0.98, "ok"),
        ("mean_fitness", 0.99, 0.98, "ok"),
        ("mean_fitness", 0.90, 0.98, "-0.080"),
        ("eps1", None, 0.01, "-"),
    ],
)
def test_verdicts(cell, ours, paper, expected):
    assert Verdict(cell, ours, paper) == expected
    if ours is not None:
        assert ReachesPaper(cell, ours, paper) == (expected == "ok")


def test_the_invariance_ratio_is_fast_by_slow():
    assert InvarianceRatio(2.0, 2.2) == pytest.approx(1.1)
    assert InvarianceRatio(None, 1.0) is None
    assert InvarianceRatio(1.0, None) is None
    assert InvarianceRatio(0.0, 1.0) is None


def test_quartiles_leave_out_what_is_not_there():
    assert Quartiles.Of([None, 8.0, 2.0, 4.0, 6.0, 10.0]) == Quartiles(
        low=4.0, median=6.0, high=8.0, count=5
    )
    assert Quartiles.Of([3.0]) == Quartiles(low=3.0, median=3.0, high=3.0, count=1)
    assert Quartiles.Of([None]) is None
