"""The report's tables, and what they say in short, as Markdown. A summary is of `Summarize`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mffdrake.experiment.paper.paper_numbers import (
    CELLS,
    PAPER,
    InvarianceRatio,
    ReachesPaper,
    Verdict,
)
from mffdrake.experiment.paper.report.figures import AXIS_LABELS, ShownWindow
from mffdrake.experiment.paper.studies import PAPER_OMEGAS
from mffdrake.experiment.paper.study import FindGroup, QuartilesOf, Reproduction, Study
from mffdrake.experiment.runs.table import Group, Markdown, Quartiles, SummaryTable
from mffdrake.experiment.simulation.evaluation import SETTLED_AFTER
from mffdrake.experiment.simulation.style import METHOD_NAMES
from mffdrake.systems.control.oscillation import FitOscillation

__all__ = [
    "INVARIANCE_LIMIT",
    "InvarianceTable",
    "OscillationTable",
    "PaperTable",
    "StudyTable",
    "SummaryLines",
]

INVARIANCE_LIMIT = 1.15
"""The error is called invariant when it grows by no more than this from slow to fast."""

_SLOW, _FAST = PAPER_OMEGAS[0], PAPER_OMEGAS[-1]


def _Form(cell: str, value: float) -> str:
    digits = 4 if cell.startswith("eps") else 3 if cell == "mean_fitness" else 2
    return f"{value:.{digits}f}"


def _WithQuartiles(cell: str, quartiles: Quartiles | None) -> str:
    if quartiles is None:
        return "-"
    low, median, high = (
        _Form(cell, value) for value in (quartiles.low, quartiles.median, quartiles.high)
    )
    return median if quartiles.count == 1 else f"{median} ({low}-{high})"


def PaperTable(summary: Sequence[Group], study: str, window: str, *, verdicts: bool = True) -> str:
    """The paper's Fig. 8 with our numbers.

    Args:
        summary: See `Summarize`.
        study: Name of a study of both methods at the paper's speeds.
        window: ``all`` or ``settled`` frames.
        verdicts: Whether our numbers have a `Verdict`.

    Returns:
        The table: for each method and figure, at each speed, our median with quartiles and the
        verdict, and the paper's number.

    Example:
        >>> print(PaperTable([], "near", "all").splitlines()[2])
        | 1-step GA | mean fitness | - | 0.8026 | - | 0.7371 | - | 0.628 |
    """
    header = ["method", "figure"]
    for omega in PAPER_OMEGAS:
        header += [f"{omega:g} rad/s", "paper"]
    rows = []
    for method, name in METHOD_NAMES.items():
        for cell, label in AXIS_LABELS.items():
            row = [name, label]
            for omega in PAPER_OMEGAS:
                ours = QuartilesOf(FindGroup(summary, study, method, omega), cell, window)
                paper = PAPER[method, omega][cell]
                shown = _Form(cell, paper) if cell in ("position_mm", "rotation_deg") else paper
                number = _WithQuartiles(cell, ours)
                if verdicts and ours:
                    number += f", {Verdict(cell, ours.median, paper)}"
                row += [number, str(shown)]
            rows.append(row)
    return Markdown(header, rows)


def StudyTable(summary: Sequence[Group], study: Study) -> str:
    """One line for each of a study's variants: figures with quartiles, and why there are none."""
    rows = [row for group in summary if group.labels["study"] == study.name for row in group.rows]
    return SummaryTable(rows, ["label"], headings={"label": "variant"}, details=True)


def OscillationTable(reproduction: Reproduction) -> str:
    """How the hand swings sideways about its path: `FitOscillation` of x, actual minus desired."""
    header = [
        "omega [rad/s]", "frequency [Hz]", "decay to 1/e [s]", "damping ratio",
        "amplitude at 0 s [mm]", "amplitude at 30 s [mm]", "share explained",
    ]  # fmt: skip
    rows = []
    for omega in PAPER_OMEGAS:
        record = reproduction.records.get(("mff", omega))
        if record is None:
            continue
        swing_mm = 1e3 * (record.actual_hand_pose - record.desired_hand_pose)[:, 0]
        try:
            fit = FitOscillation(record.time, swing_mm, slow_omega=omega)
        except ValueError:
            rows.append([f"{omega:g}", *["too short a run"], *["-"] * 5])
            continue
        rows.append(
            [
                f"{omega:g}", f"{fit.frequency_hz:.3f}", f"{fit.decay_s:.1f}",
                f"{fit.damping_ratio:.4f}", f"{fit.amplitude:.1f}", f"{fit.AmplitudeAt(30.0):.1f}",
                f"{fit.explained:.2f}",
            ]
        )  # fmt: skip
    return Markdown(header, rows)


def _Ratio(
    summary: Sequence[Group], study: str, method: str, window: str
) -> tuple[float | None, float | None, float | None]:
    """Position error at the lowest and at the highest speed [mm], and how they compare."""
    errors = []
    for omega in (_SLOW, _FAST):
        group = FindGroup(summary, study, method, omega)
        quartiles = QuartilesOf(group, "position_mm", window)
        errors.append(quartiles.median if quartiles else None)
    return (*errors, InvarianceRatio(*errors))  # type: ignore[return-value]


def InvarianceTable(summary: Sequence[Group]) -> str:
    """How the position error grows with the hand's speed: ours, the paper's, a fixed camera's."""
    window = ShownWindow(summary)
    rows = []
    for study, start in (
        ("random", "random start"),
        ("near", "start near the target"),
        ("refined", "refined"),
    ):
        for method, name in METHOD_NAMES.items():
            slow, fast, ratio = _Ratio(summary, study, method, window)
            rows.append([f"{name}, {start}", *(_Number(x) for x in (slow, fast, ratio))])
    for method, name in METHOD_NAMES.items():
        slow, fast = (PAPER[method, omega]["position_mm"] for omega in (_SLOW, _FAST))
        values = (slow, fast, InvarianceRatio(slow, fast))
        rows.append([f"the paper's {name}, 0-40 s", *(_Number(x) for x in values)])
    for group in summary:
        if group.labels["study"] == "fixed":
            error = QuartilesOf(group, "position_mm", window)
            label = group.labels["label"]
            rows.append([label, _Number(error.median if error else None), "-", "-"])
    header = ["method", f"at {_SLOW:g} rad/s [mm]", f"at {_FAST:g} rad/s [mm]", "ratio"]
    return Markdown(header, rows)


def _Number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def SummaryLines(summary: Sequence[Group]) -> Iterator[str]:
    """Sentences: what agrees with the paper and what does not, from the numbers alone."""
    for study, start in (("near", "a start near the target"), ("random", "a random start")):
        cells = [
            (omega, cell, ours, QuartilesOf(group, cell, "settled"))
            for omega in PAPER_OMEGAS
            if (group := FindGroup(summary, study, "mff", omega))
            for cell in CELLS
            if (ours := QuartilesOf(group, cell, "all"))
        ]
        if not cells:
            continue
        misses = [
            (omega, cell, settled) for omega, cell, ours, settled in cells
            if not ReachesPaper(cell, ours.median, PAPER["mff", omega][cell])
        ]  # fmt: skip
        text = (
            f"With feedforward, from {start}, over all frames, {len(cells) - len(misses)} of "
            f"{len(cells)} medians are at least as good as the paper's."
        )
        late = [
            (omega, cell) for omega, cell, settled in misses
            if not settled or not ReachesPaper(cell, settled.median, PAPER["mff", omega][cell])
        ]  # fmt: skip
        if len(misses) > len(late):
            text += f" {len(misses) - len(late)} more are so without the first {SETTLED_AFTER:g} s:"
            text += " there the search at the start is the reason."
        if late:
            text += f" Not so in either window: {_Where(late)}."
        fitness = [ours.median for _, cell, ours, _ in cells if cell == "mean_fitness"]
        text += f" Its mean fitness is {_List(fitness, '.3f')}: " + (
            "at least 0.98 throughout." if min(fitness) >= 0.98 else "below 0.98 somewhere."
        )
        yield text
    parts = []
    for method, name in (("ga", "without"), ("mff", "with")):
        groups = [FindGroup(summary, "plain", method, omega) for omega in PAPER_OMEGAS]
        errors = [QuartilesOf(group, "position_mm", "all") for group in groups]
        medians = [one.median for one in errors if one]
        if len(medians) == len(PAPER_OMEGAS):
            paper = [PAPER[method, omega]["position_mm"] for omega in PAPER_OMEGAS]
            parts.append(
                f"{_List(medians, '.1f')} mm {name} feedforward "
                f"(the paper: {_List(paper, '.1f')} mm)"
            )
    if parts:
        yield (
            "The plain GA, which is what the paper describes and no more, has position errors of "
            f"{' and '.join(parts)}."
        )
    window = ShownWindow(summary)
    for method, name in (("mff", "With feedforward"), ("ga", "Without")):
        _, _, ratio = _Ratio(summary, "near", method, window)
        if ratio is not None:
            limit = "at most" if ratio <= INVARIANCE_LIMIT else "above"
            yield (
                f"{name}, the position error at {_FAST:g} rad/s is {ratio:.2f} times that at "
                f"{_SLOW:g} rad/s ({limit} {INVARIANCE_LIMIT:g}); the paper's is "
                f"{_PaperRatio(method):.2f} times."
            )


def _List(values: Sequence[float], form: str) -> str:
    return ", ".join(format(value, form) for value in values)


def _Where(cells: Sequence[tuple[float, str]]) -> str:
    """Figures and the speeds at which they are meant."""
    speeds: dict[str, list[str]] = {}
    for omega, cell in cells:
        speeds.setdefault(AXIS_LABELS[cell].split(" [")[0], []).append(f"{omega:g}")
    parts = [f"{name} at {', '.join(omegas)}" for name, omegas in speeds.items()]
    return f"{'; '.join(parts)} rad/s"


def _PaperRatio(method: str) -> float:
    return PAPER[method, _FAST]["position_mm"] / PAPER[method, _SLOW]["position_mm"]
