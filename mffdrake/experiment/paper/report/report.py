"""Writes the report of a reproduction: Markdown, HTML, pictures and numbers."""

from __future__ import annotations

import base64
import dataclasses as dc
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mffdrake.experiment.paper.report.figures import AXIS_LABELS, PlotStudies, PlotTable
from mffdrake.experiment.paper.report.text import MakeText
from mffdrake.experiment.paper.studies import PAPER_OMEGAS, MakeStudies
from mffdrake.experiment.paper.study import (
    QuartilesOf,
    Reproduction,
    RunStudies,
    Study,
    Summarize,
)
from mffdrake.experiment.runs.engine import EndedRun
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.store import CodeFingerprint
from mffdrake.experiment.runs.table import Group, WriteJson, WriteRows
from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.plotting import PlotHandPath, PlotPose, SaveFigure
from mffdrake.recognition.recordings.files import WholeFile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MakeHtml", "Reproduce", "WriteReport"]


def Reproduce(
    folder: Path | str,
    *,
    studies: Sequence[Study] | None = None,
    base: Scenario | None = None,
    executor: Executor | None = None,
    on_run: Callable[[EndedRun], None] | None = None,
) -> Reproduction:
    """Runs the paper's experiment, with statistics and more, and writes the report.

    What the folder has from before, by this very code, is not run again.

    Args:
        folder: The folder, which is made where there is none.
        studies: What to run; `MakeStudies` with its defaults without.
        base: What the studies' scenarios are on top of; the defaults without.
        executor: Where to run; processes of this machine, one a core, by default.
        on_run: Called for every distinct run that has ended, see `RunPlan`.

    Returns:
        What came out; for the files see `WriteReport`.

    Raises:
        ScenarioError: When a scenario is wrong.
        StoreError: When the folder's store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).
        OSError: When a file cannot be written.

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.runs.executors.executors import InProcess
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> folder = tempfile.mkdtemp()
        >>> base = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> one = MakeStudies(short=True)[2:3]
        >>> result = Reproduce(folder, studies=one, base=base, executor=InProcess())
        >>> result.rows[0]["label"], (Path(folder) / "report.html").exists()
        ('fixed, middle', True)
    """
    chosen = MakeStudies() if studies is None else studies
    reproduction = RunStudies(chosen, base or Scenario(), folder, executor=executor, on_run=on_run)
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

    Example:
        >>> import tempfile
        >>> from mffdrake.experiment.runs.executors.executors import InProcess
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> base = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> folder, studies = tempfile.mkdtemp(), MakeStudies(short=True)[2:3]
        >>> WriteReport(RunStudies(studies, base, folder, executor=InProcess()), folder).name
        'report.md'
    """
    folder = Path(folder)
    summary = Summarize(reproduction.rows)
    _WriteNumbers(reproduction.rows, summary, folder)
    pictures = []
    for name, figure in _Figures(reproduction, summary):
        SaveFigure(figure, folder / name)
        pictures.append(name)
    text = MakeText(reproduction, summary, pictures)
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

    style = Path(__file__).with_suffix(".css").read_text(encoding="utf-8")
    body = markdown.markdown(markdown_text, extensions=["tables"])

    def Embed(match: re.Match[str]) -> str:
        content = base64.b64encode((Path(folder) / match[1]).read_bytes()).decode("ascii")
        return f'src="data:image/png;base64,{content}"'

    heading = re.search(r"<h1>(.*?)</h1>", body)
    body = re.sub(r'src="([^":]+)"', Embed, body)
    title = re.sub(r"<.*?>", "", heading[1]) if heading else "Report"
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>'
        f"\n<style>{style}</style>\n</head>\n<body>\n"
        f"{body}\n</body>\n</html>\n"
    )


def _WriteNumbers(rows: Sequence[dict[str, Any]], summary: Sequence[Group], folder: Path) -> None:
    """Rows, and medians and quartiles of the figures of the paper's table."""
    about = {"code": CodeFingerprint()}
    variants = []
    for group in summary:
        entry = {**group.labels, "done": len(group.done), "error": group.error}
        for window in ("all", "settled"):
            cells = {cell: QuartilesOf(group, cell, window) for cell in AXIS_LABELS}
            entry[window] = {cell: q and dc.asdict(q) for cell, q in cells.items()}
        variants.append(entry)
    WriteJson({"runs": list(rows), **about}, folder / "runs.json")
    WriteJson({"variants": variants, **about}, folder / "summary.json")
    WriteRows(rows, folder / "runs.csv")


def _Figures(reproduction: Reproduction, summary: Sequence[Group]) -> Iterator[tuple[str, Figure]]:
    records = reproduction.records
    slow, fast = PAPER_OMEGAS[0], PAPER_OMEGAS[-1]
    if ("mff", slow) in records:
        yield "fig6.png", PlotHandPath(records["mff", slow])
    for name, omega in (("fig7.png", slow), ("fig7_fast.png", fast)):
        pair = [records[method, omega] for method in ("ga", "mff") if (method, omega) in records]
        if pair:
            yield name, PlotPose(pair)
    yield "fig8.png", PlotTable(summary)
    studies = PlotStudies(summary)
    if studies is not None:
        yield "studies.png", studies
