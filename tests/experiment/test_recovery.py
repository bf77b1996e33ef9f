"""Frames without the target, of constructed records."""

import numpy as np
import pytest

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.recovery import RECOVERY, CalcRecovery, OutageEnd

TIME = 0.033 * np.arange(10)


def recovery(right, outage_end=None):
    """The figures of frames written as 1 for right and 0 for not."""
    flags = np.array([int(c) for c in right], dtype=bool)
    return CalcRecovery(TIME[: len(right)], flags, outage_end)


def test_the_figures_are_those_that_are_announced():
    for figures in (recovery("0111"), recovery("0000", 0.05)):
        assert list(figures) == list(RECOVERY)
        for name, value in figures.items():
            assert value is None or type(value) is RECOVERY[name][0]


@pytest.mark.parametrize(
    ("right", "first", "longest"),
    [
        ("1111", 0, 0), ("0011", 2, 0), ("0001000", 3, 3), ("1001000100", 0, 3),
        ("0100", 1, 2), ("0000", None, None),
    ],
)  # fmt: skip
def test_the_longest_stretch_leaves_out_the_search_at_the_start(right, first, longest):
    figures = recovery(right)
    assert (figures["first_right"], figures["longest_wrong"]) == (first, longest)


@pytest.mark.parametrize(
    ("right", "end", "frames", "recovered"),
    [
        ("1110001111", 3 * 0.033, 3, True),  # A frame just at the end is one of those after it.
        ("1110001111", 0.18, 0, True),
        ("1110000000", 0.15, None, False),
        ("1111111111", 0.15, 0, True),
        ("0000000000", 0.15, None, False),
        ("1110001111", 0.033 * 9 + 0.001, None, None),
        ("1110001111", None, None, None),
    ],
)
def test_frames_to_recover_count_from_the_end_of_the_outage(right, end, frames, recovered):
    figures = recovery(right, end)
    assert (figures["after_outage"], figures["recovered"]) == (frames, recovered)


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("{}", None),
        ("disturbances: [!GaussianNoise {}]", None),
        ("clutter: [!Occluder {}]", None),  # To and fro for ever.
        ("clutter: [!Occluder {start: 1, duration: 2}]", 3.0),
        ("disturbances: [!Frozen {start: 2, duration: 0.5}]", 2.5),
        ("disturbances: [!Black {starts: [3, 1], duration: 0.5}, !Frozen {start: 1}]", 3.5),
    ],
)
def test_an_outage_ends_with_the_last_of_its_parts(text, end):
    assert OutageEnd(LoadScenario(text=text)) == end
