"""What the report says, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence

from mffdrake.experiment.paper.report.figures import ShownWindow
from mffdrake.experiment.paper.report.tables import (
    InvarianceTable,
    OscillationTable,
    PaperTable,
    StudyTable,
    SummaryLines,
)
from mffdrake.experiment.paper.study import Reproduction
from mffdrake.experiment.runs.store import Versions
from mffdrake.experiment.runs.table import Group
from mffdrake.experiment.simulation.evaluation import SETTLED_AFTER

__all__ = ["MakeText"]

_TABLES = ("near", "random", "vtk_near", "vtk", "plain")
_PICTURES = {
    "fig6.png": "Desired and actual hand pose in the first hand frame",
    "fig7.png": "True and recognized pose at the lowest speed",
    "fig7_fast.png": "True and recognized pose at the highest speed",
    "fig8.png": "Mean fitness and errors, ours and the paper's",
    "studies.png": "Position error against speed, latency, gain, calibration, noise",
}


def MakeText(
    reproduction: Reproduction, summary: Sequence[Group], pictures: Collection[str]
) -> str:
    """The whole report.

    Args:
        reproduction: What came out.
        summary: See `Summarize`.
        pictures: Names of the pictures that there are; others are not mentioned.

    Example:
        >>> nothing = Reproduction(studies=(), rows=(), records={})
        >>> MakeText(nothing, [], []).splitlines()[0]
        "# The paper's experiment, reproduced"
    """

    def Show(name: str) -> Iterator[str]:
        if name in pictures:
            yield f"![{_PICTURES[name]}]({name})"

    return "\n\n".join(_Sections(reproduction, summary, Show)) + "\n"


_Show = Callable[[str], Iterator[str]]


def _Sections(reproduction: Reproduction, summary: Sequence[Group], show: _Show) -> Iterator[str]:
    yield from _Beginning(reproduction, summary)
    yield from _TheHand(reproduction, show)
    yield from _TheTables(reproduction, summary, show)
    yield "## Invariance"
    yield (
        "The paper's claim is that with feedforward the error does not depend on the hand's speed, "
        "as if the camera was fixed. Root-mean-square position error at the highest and the lowest "
        f"of its speeds, medians{_Frames(summary)}, and the ratio of the two:"
    )
    yield InvarianceTable(summary)
    yield "## What the error depends on"
    yield f"Medians and, in brackets, quartiles over the seeds{_Frames(summary)}."
    yield from show("studies.png")
    for study in reproduction.studies:
        if study.name not in _TABLES:
            yield f"### {study.title}"
            yield study.question
            yield StudyTable(summary, study)
    yield "## Numbers"
    versions = ", ".join(f"{name} {version}" for name, version in Versions().items())
    yield (
        "Every run is a row of `runs.csv` and `runs.json`; the medians and quartiles of all errors "
        f"over both windows are in `summary.json`. {versions}."
    )


def _Frames(summary: Sequence[Group]) -> str:
    settled = ShownWindow(summary) == "settled"
    return f", without the first {SETTLED_AFTER:g} s" if settled else ", over all frames"


def _Count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _Beginning(reproduction: Reproduction, summary: Sequence[Group]) -> Iterator[str]:
    yield "# The paper's experiment, reproduced"
    done = [row for row in reproduction.rows if row["status"] == "done"]
    durations = sorted({row["duration"] for row in done})
    seconds = " and ".join(f"{duration:g} s" for duration in durations) or "no run"
    seeds = {study.name: study.seeds for study in reproduction.studies}
    table = max(seeds.values(), default=0)
    yield (
        "The experiment of *On-line Motion-Feedforward Pose Recognition Invariant for Dynamic "
        "Hand-eye Motion*: an arm swings a stereo camera around a box, whose pose is recognized "
        "with one generation of a genetic algorithm (GA) a video frame, without and with motion "
        f"feedforward (MFF). {_Count(len(done), 'run')} of {seconds} (one that several studies "
        f"share counts in each), up to {_Count(table, 'seed')} of a variant. The "
        "paper's numbers are of one run each."
    )
    failures = reproduction.Failures()
    if failures:
        yield f"**{_Count(len(failures), 'run')} failed**; the first: {failures[0]['error']}"
    lines = list(SummaryLines(summary))
    if lines:
        yield "## In short"
        yield "\n".join(f"- {line}" for line in lines)


def _TheHand(reproduction: Reproduction, show: _Show) -> Iterator[str]:
    yield "## The hand's motion (Fig. 6)"
    yield (
        "The hand starts at rest while its path starts at full speed, which the lightly damped "
        "arm answers by swinging."
    )
    yield from show("fig6.png")
    yield (
        "Measured from the runs: one decaying oscillation is fitted to the difference, actual "
        "minus desired, of the sideways coordinate x, beside a constant and the path's own "
        "frequency (least squares; frequency and decay rate searched on a grid that shrinks). The "
        "last column is the share of the swing's variance that it explains; the rest is the arm's "
        "other modes."
    )
    yield OscillationTable(reproduction)


def _TheTables(reproduction: Reproduction, summary: Sequence[Group], show: _Show) -> Iterator[str]:
    yield "## Recognition over time (Fig. 7)"
    yield "The first seed, started near the target, at the lowest and at the highest speed."
    yield from show("fig7.png")
    yield from show("fig7_fast.png")
    yield "## Fitness and errors (Fig. 8)"
    yield (
        "Medians over the seeds, their quartiles in brackets, of mean fitness and root-mean-square "
        "errors. The last two rows of each method, distance and angle, are not in the paper; they "
        "follow from its others. After our numbers: *ok* where they are at least as good as the "
        "paper's; *x2.0* where an error is twice the paper's; *-0.030* where the fitness is that "
        "much below."
    )
    yield from show("fig8.png")
    for study in reproduction.studies:
        if study.name in _TABLES:
            yield f"### {study.title}"
            yield study.question
            yield f"{_Count(study.seeds, 'seed')}. Over all frames, as in the paper:"
            yield PaperTable(summary, study.name, "all")
            if study.name in ("random", "vtk") and ShownWindow(summary) == "settled":
                yield f"Without the first {SETTLED_AFTER:g} s:"
                yield PaperTable(summary, study.name, "settled")
