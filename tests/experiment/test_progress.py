"""A log gets a line now and then, a terminal a bar."""

import io
import sys

import numba
import pytest

from mffdrake.experiment.progress import ProgressBar, RunBar, TellCompiling
from mffdrake.experiment.runs.engine import EndedRun, PlannedRun
from mffdrake.experiment.runs.store import Record
from mffdrake.experiment.scenario.scenario import Scenario


def lines(monkeypatch, *, interval):
    log = io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    with ProgressBar(total=4, desc="simulations", interval=interval) as bar:
        for _ in range(4):
            bar.set_postfix_str("2 failed", refresh=False)
            bar.update(1)
    return log.getvalue()


def test_a_log_gets_whole_lines_of_plain_text(monkeypatch):
    text = lines(monkeypatch, interval=0.0)
    assert "\r" not in text and text.endswith("\n")
    assert text.splitlines()[-1].startswith("mffdrake: simulations: 100 % after 00:0")
    assert text.splitlines()[-1].endswith(", 2 failed")
    assert all(line.startswith("mffdrake: simulations: ") for line in text.splitlines())


def test_work_that_is_soon_done_leaves_no_line(monkeypatch):
    assert lines(monkeypatch, interval=3600.0) == ""


@pytest.mark.parametrize("watched", [True, False])
def test_who_watches_is_told_once_that_functions_are_compiled(monkeypatch, watched):
    monkeypatch.setattr(sys, "stderr", log := io.StringIO())
    monkeypatch.setattr(log, "isatty", lambda: watched)
    with TellCompiling():
        assert log.getvalue() == ""  # before anything is
        for _ in range(2):
            assert numba.njit(lambda x: x + 1)(1) == 2
    assert log.getvalue().count("compiling once for this machine") == watched
    assert numba.njit(lambda x: x + 1)(1) == 2
    assert log.getvalue().count("compiling") == watched


def test_bars_may_be_switched_off(monkeypatch):
    monkeypatch.setattr(sys, "stderr", log := io.StringIO())
    monkeypatch.setenv("TQDM_DISABLE", "1")
    run = PlannedRun(scenario=Scenario())
    with RunBar([run]) as on_run:
        on_run(EndedRun(run=run, record=Record(row={}), was_kept=True))
        on_run(EndedRun(run=run, record=Record(error="no")))
    assert log.getvalue() == ""
