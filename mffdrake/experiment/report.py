"""Writes the report of a reproduction: Markdown, HTML, pictures and numbers."""

from __future__ import annotations

import base64
import csv
import dataclasses as dc
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.evaluation import SETTLED_AFTER, FlattenRow, Versions
from mffdrake.experiment.executors import Executor
from mffdrake.experiment.files import WholeFile
from mffdrake.experiment.fingerprint import CodeFingerprint
from mffdrake.experiment.plotting import PlotHandPath, PlotPose, SaveFigure
from mffdrake.experiment.report_figures import PlotStudies, PlotTable, ShownWindow
from mffdrake.experiment.report_tables import (
    InvarianceTable,
    OscillationTable,
    PaperTable,
    StudyTable,
    SummaryLines,
)
from mffdrake.experiment.reproduction import Reproduction, RunPlan, Summarize
from mffdrake.experiment.scenario import Scenario
from mffdrake.experiment.store import Record
from mffdrake.experiment.studies import (
    PAPER_OMEGAS,
    MakeStudies,
    PlannedRun,
    PlanRuns,
    Study,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MakeHtml", "Reproduce", "WriteReport"]

_TABLES = ("near", "random", "vtk_near", "vtk")
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 75em; margin: 2em auto; padding: 0 1em;
       color: #222; background: #fff; }
img { max-width: 100%; }
table { border-collapse: collapse; font-size: 85%; margin: 1em 0; display: block;
        overflow-x: auto; }
th, td { border: 1px solid #ccc; padding: .2em .5em; text-align: left; white-space: nowrap; }
td:last-child { white-space: normal; }
th { background: #f2f2f2; }
tr:nth-child(even) td { background: #fafafa; }
code { background: #f2f2f2; padding: 0 .2em; }
"""


def Reproduce(
    folder: Path | str,
    *,
    studies: Sequence[Study] | None = None,
    base: Scenario | None = None,
    executor: Executor | None = None,
    on_run: Callable[[PlannedRun, Record, bool], None] | None = None,
) -> Reproduction:
    """Runs the paper's experiment, with statistics and more, and writes the report.

    What the folder has from before, by this very code, is not run again.

    Args:
        folder: The folder, which is made where there is none.
        studies: What to run; `MakeStudies` with its defaults without.
        base: What the studies' scenarios are on top of; the defaults without.
        executor: Where to run; processes of this machine, one a core, by default.
        on_run: See `RunPlan`.

    Returns:
        What came out; for the files see `WriteReport`.

    Raises:
        ScenarioError: When a scenario is wrong.
        StoreError: When the folder's store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).
        OSError: When a file cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.executors import InProcess
        >>> from mffdrake.experiment.scenario import LoadScenario
        >>> folder = tempfile.mkdtemp()
        >>> base = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> one = MakeStudies(short=True)[2:3]
        >>> result = Reproduce(folder, studies=one, base=base, executor=InProcess())
        >>> result.rows[0]["label"], (Path(folder) / "report.html").exists()
        ('fixed, middle', True)
    """
    plan = PlanRuns(MakeStudies() if studies is None else studies, base or Scenario())
    reproduction = RunPlan(plan, folder, executor=executor, on_run=on_run)
    WriteReport(reproduction, folder)
    return reproduction


def WriteReport(reproduction: Reproduction, folder: Path | str) -> Path:
    """Writes everything, each file whole or not at all, the report last.

    Args:
        reproduction: What came out.
        folder: An existing folder. It gets ``report.md``, ``report.html`` (which needs no other
            file), the pictures, ``runs.csv`` and ``runs.json`` (a row a run) and ``summary.json``
            (medians and quartiles).

    Returns:
        The Markdown file.

    Raises:
        OSError: When a file cannot be written.
    """
    folder = Path(folder)
    summary = Summarize(reproduction.rows)
    _WriteNumbers(reproduction.rows, summary, folder)
    for name, figure in _Figures(reproduction, summary):
        SaveFigure(figure, folder / name)
    text = "\n\n".join(_Sections(reproduction, summary)) + "\n"
    page = MakeHtml(text, folder)
    for name, content in (("report.html", page), ("report.md", text)):
        with WholeFile(folder / name) as part:
            part.write_text(content, encoding="utf-8")
    return folder / "report.md"


def MakeHtml(markdown_text: str, folder: Path | str) -> str:
    """Turns Markdown into a page that needs no other file.

    Args:
        markdown_text: The text; its pictures are PNG files.
        folder: Where the pictures are.

    Returns:
        The page, with the pictures in it.

    Raises:
        OSError: When a picture cannot be read.

    Example:
        >>> page = MakeHtml("# A *title*", ".")
        >>> "<title>A title</title>" in page, "<h1>A <em>title</em></h1>" in page
        (True, True)
    """
    import markdown

    body = markdown.markdown(markdown_text, extensions=["tables"])

    def Embed(match: re.Match[str]) -> str:
        content = base64.b64encode((Path(folder) / match[1]).read_bytes()).decode("ascii")
        return f'src="data:image/png;base64,{content}"'

    heading = re.search(r"<h1>(.*?)</h1>", body)
    body = re.sub(r'src="([^":]+)"', Embed, body)
    title = re.sub(r"<.*?>", "", heading[1]) if heading else "Report"
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>'
        f"\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"{body}\n</body>\n</html>\n"
    )


def _WriteNumbers(
    rows: Sequence[dict[str, Any]], summary: Sequence[dict[str, Any]], folder: Path
) -> None:
    about = {"versions": Versions(), "code": CodeFingerprint()}
    plain = [
        {
            **entry,
            **{
                window: {k: q and dc.asdict(q) for k, q in entry[window].items()}
                for window in ("all", "settled")
            },
        }
        for entry in summary
    ]
    for name, data in (
        ("runs.json", {"runs": list(rows), **about}),
        ("summary.json", {"variants": plain, **about}),
    ):
        with WholeFile(folder / name) as part:
            part.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    flat = [FlattenRow(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    with (
        WholeFile(folder / "runs.csv") as part,
        part.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.DictWriter(file, fieldnames=names)
        writer.writeheader()
        writer.writerows(flat)


def _Figures(
    reproduction: Reproduction, summary: Sequence[dict[str, Any]]
) -> Iterator[tuple[str, Figure]]:
    records = reproduction.records
    slow, fast = PAPER_OMEGAS[0], PAPER_OMEGAS[-1]
    if ("mff", slow) in records:
        yield "fig6.png", PlotHandPath(records["mff", slow])
    for name, omega in (("fig7.png", slow), ("fig7_fast.png", fast)):
        pair = [records[method, omega] for method in ("ga", "mff") if (method, omega) in records]
        if pair:
            yield name, PlotPose(pair)
    yield "fig8.png", PlotTable(summary)
    yield "studies.png", PlotStudies(summary)


def _Sections(reproduction: Reproduction, summary: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield from _Beginning(reproduction, summary)
    yield from _TheHand(reproduction)
    yield from _TheTables(reproduction, summary)
    yield "## Invariance"
    yield (
        "The paper's claim is that with feedforward the error does not depend on the hand's speed, "
        "as if the camera was fixed. Root-mean-square position error at the highest and the lowest "
        f"of its speeds, medians{_Frames(summary)}, and the ratio of the two:"
    )
    yield InvarianceTable(summary)
    yield "## What the error depends on"
    yield f"Medians and, in brackets, quartiles over the seeds{_Frames(summary)}."
    yield "![Position error against speed, latency, gain, calibration, noise](studies.png)"
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


def _Frames(summary: Sequence[dict[str, Any]]) -> str:
    settled = ShownWindow(summary) == "settled"
    return f", without the first {SETTLED_AFTER:g} s" if settled else ", over all frames"


def _Beginning(reproduction: Reproduction, summary: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "# The paper's experiment, reproduced"
    done = [row for row in reproduction.rows if row["status"] == "done"]
    durations = sorted({row["duration"] for row in done})
    seconds = " and ".join(f"{duration:g} s" for duration in durations) or "no run"
    seeds = {study.name: study.seeds for study in reproduction.studies}
    table = max(seeds.values())
    yield (
        "The experiment of *On-line Motion-Feedforward Pose Recognition Invariant for Dynamic "
        "Hand-eye Motion*: an arm swings a stereo camera around a box, whose pose is recognized "
        "with one generation of a genetic algorithm (GA) a video frame, without and with motion "
        f"feedforward (MFF). {len(done)} simulations of {seconds}; up to {table} seeds each. The "
        "paper's numbers are of one run each."
    )
    failures = reproduction.Failures()
    if failures:
        yield f"**{len(failures)} runs failed**; the first: {failures[0]['error']}"
    lines = list(SummaryLines(summary))
    if lines:
        yield "## In short"
        yield "\n".join(f"- {line}" for line in lines)


def _TheHand(reproduction: Reproduction) -> Iterator[str]:
    yield "## The hand's motion (Fig. 6)"
    yield (
        "The hand starts at rest while its path starts at full speed, which the lightly damped "
        "arm answers by swinging."
    )
    yield "![Desired and actual hand pose in the first hand frame](fig6.png)"
    yield (
        "Measured from the runs: one decaying oscillation is fitted to the difference, actual "
        "minus desired, of the sideways coordinate x, beside a constant and the path's own "
        "frequency (least squares; frequency and decay rate searched on a grid that shrinks). The "
        "last column is the share of the swing's variance that it explains; the rest is the arm's "
        "other modes."
    )
    yield OscillationTable(reproduction)


def _TheTables(reproduction: Reproduction, summary: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "## Recognition over time (Fig. 7)"
    yield "The first seed, started near the target, at the lowest and at the highest speed."
    yield "![True and recognized pose at the lowest speed](fig7.png)"
    yield "![True and recognized pose at the highest speed](fig7_fast.png)"
    yield "## Fitness and errors (Fig. 8)"
    yield (
        "Medians over the seeds, their quartiles in brackets, of mean fitness and root-mean-square "
        "errors. The last two rows of each method, distance and angle, are not in the paper; they "
        "follow from its others."
    )
    yield "![Mean fitness and errors, ours and the paper's](fig8.png)"
    for study in reproduction.studies:
        if study.name in _TABLES:
            yield f"### {study.title}"
            yield study.question
            yield f"{study.seeds} seeds. Over all frames, as in the paper:"
            yield PaperTable(summary, study.name, "all")
            if study.name in ("random", "vtk") and ShownWindow(summary) == "settled":
                yield f"Without the first {SETTLED_AFTER:g} s:"
                yield PaperTable(summary, study.name, "settled")
