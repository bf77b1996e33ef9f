"""The page of the robustness study: every number in it is read off the runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from robustness_conditions import MOTIONS, texts
from tables import markdown

Row = dict[str, Any]
METHODS = ("ga", "mff")
FEW = 5  # lines of the list of what costs most

INTRODUCTION = """# Robustness

Written by `python benchmarks/robustness.py --seeds {seeds} --duration {duration:g}`{only}: {runs}
runs of {duration:g} s, each with {frames} frames of 640 x 480 pixels, from a random start, with the
flat renderer and `recognizer: {{refinement: borders}}`; seeds from {first} on, others than those
that the parameters were tuned on. Code: {code}.

Two motions: {motions} (`scenarios/shaking_hand.yaml`). `ga`
is without motion feedforward, `mff` with it.

- *error*: root-mean-square distance from the true position [mm], over the frames whose pose the
  tracker calls good (`is_tracking`); median over the seeds.
- *right*: share of the frames whose pose is within 5 mm and 1 deg of the truth.
- *tracking*: share of the frames whose pose the tracker calls good.
- *false*: share of the frames whose pose it calls good although it is not right.
- *missed*: share of the frames whose pose it does not call good although it is right. A pose that
  is carried along by the feedforward while nothing can be seen counts here too.
- *longest*: the longest stretch of frames that are not right, after the first right one; median
  over the seeds, and in brackets the longest of all.
- *recover*: frames from the end of the outage to the first right one, 0 where the pose is right at
  once; median over the seeds, which counts runs without any as endless, and in brackets the number
  of those runs, if any.

Shares are means over the seeds and count every frame, those of the search at the start too. The
lines *none* of the tables are the undisturbed runs of the same seeds."""


def page(rows: Sequence[Row], options: argparse.Namespace, code: str) -> str:
    """The whole page.

    Args:
        rows: All runs' rows, of `Evaluate`, with ``group``, ``strength``, ``motion``, ``status``.
        options: ``seeds``, ``duration`` and ``only``.
        code: What they were run by.
    """
    done = [row for row in rows if row["status"] == "done"]
    only = " ".join(f'"{name}"' if " " in name else name for name in options.only)
    parts = [
        INTRODUCTION.format(
            seeds=options.seeds, duration=options.duration, only=f" `--only {only}`" * bool(only),
            runs=len(done), frames=max((row["frames"] for row in done), default=0),
            first=min(row["seed"] for row in rows), code=code,
            motions=" and ".join(MOTIONS.values()),
        )
    ]  # fmt: skip
    failures = [row for row in rows if row["status"] == "failed"]
    if failures:
        parts.append("## Failed runs\n\n" + "\n".join(_failure(row) for row in failures))
    if done:
        parts += ["## In all\n\n" + totals(done), _ranking(done)]
        parts.append(
            "![Shares of right, false and missed frames for every condition](images/robustness.png)"
        )
    for group, text in texts().items():
        members = [row for row in done if row["group"] == group]
        if members:
            title = group[0].upper() + group[1:]
            parts.append(f"## {title}\n\n{text} {summary(done, group)}\n\n{table(done, group)}")
    return "\n\n".join(part for part in parts if part) + "\n"


def _failure(row: Row) -> str:
    where = f"{row['group']}, {row['strength']}, {row['motion']}, `{row['method']}`"
    return f"- {where}, seed {row['seed']}: {row['error']}"


def select(rows: Iterable[Row], **values: Any) -> list[Row]:
    """The rows with these values."""
    return [row for row in rows if all(row[key] == value for key, value in values.items())]


def share(rows: Sequence[Row], name: str) -> float:
    """Mean of a share over the seeds."""
    return float(np.mean([row[f"tracking.{name}"] for row in rows]))


def percent(value: float) -> str:
    """A share; one that is not 0 does not look like it, and one below 1 not like 1."""
    return "0 %" if value == 0.0 else "100 %" if value == 1.0 else f"{100 * value:.2f} %"


def totals(rows: Sequence[Row]) -> str:
    """False and missed frames of all conditions together."""
    lines: list[list[object]] = []
    for motion in (*MOTIONS, None):
        for method in METHODS if motion else (None,):
            given = {"motion": motion, "method": method} if motion else {}
            members = select(rows, **given)
            frames = sum(row["frames"] for row in members)
            if not frames:
                continue
            cells: list[object] = [motion or "both", method or "both", frames]
            for name in ("right", "says_so", "false", "missed"):
                count = sum(round(row[f"tracking.{name}"] * row["frames"]) for row in members)
                cells.append(f"{count} ({percent(count / frames)})")
            lines.append(cells)
    return markdown(["motion", "method", "frames", "right", "tracking", "false", "missed"], lines)


def _groups(rows: Sequence[Row]) -> dict[tuple[str, str, str, str], list[Row]]:
    """The seeds' rows of each group, strength, motion and method, in order of appearance."""
    found: dict[tuple[str, str, str, str], list[Row]] = {}
    for row in rows:
        key = (row["group"], row["strength"], row["motion"], row["method"])
        found.setdefault(key, []).append(row)
    return found


def _ranking(rows: Sequence[Row]) -> str:
    """Sentences on what costs most, read off the rows."""
    groups = _groups(rows)
    disturbed = {key: members for key, members in groups.items() if key[0] != "none"}
    clean = sum(share(members, "false") == 0.0 for members in groups.values())
    text = [
        f"A line of a table below is a condition for one motion and one method: {len(groups)} in "
        f"all. In {clean} of them no frame of any seed is false."
    ]
    falsest = sorted(disturbed, key=lambda key: -share(groups[key], "false"))[:FEW]
    falsest = [key for key in falsest if share(groups[key], "false") > 0.0]
    if falsest:
        named = (f"{_named(key)}: {percent(share(groups[key], 'false'))}" for key in falsest)
        text.append("Most false frames:\n\n" + "\n".join(f"- {name}" for name in named))
    lost = {
        key: share(groups["none", "-", *key[2:]], "right") - share(members, "right")
        for key, members in disturbed.items()
        if ("none", "-", *key[2:]) in groups
    }
    costly = [key for key in sorted(lost, key=lambda key: -lost[key])[:FEW] if lost[key] > 0.0]
    if costly:
        named = (f"{_named(key)}: {percent(lost[key])} of the frames" for key in costly)
        text.append(
            "Most right frames lost, against the same motion and method without a disturbance:"
            "\n\n" + "\n".join(f"- {name}" for name in named)
        )
    return "\n\n".join(text)


def _named(key: tuple[str, str, str, str]) -> str:
    group, strength, motion, method = key
    return f"{group}, {strength} ({motion}, `{method}`)"


def summary(rows: Sequence[Row], group: str) -> str:
    """Sentences on one group, read off the rows."""
    groups = {key: found for key, found in _groups(rows).items() if key[0] == group}
    strengths = list(dict.fromkeys(key[1] for key in groups))
    curves = []
    for motion in MOTIONS:
        for method in METHODS:
            members = [groups.get((group, s, motion, method)) for s in strengths]
            values = [percent(share(found, "right")) for found in members if found]
            if values:
                curves.append(f"{', '.join(values)} ({motion}, `{method}`)")
    order = "" if len(strengths) == 1 else ", in the order of the strengths"
    worst = max(groups, key=lambda key: share(groups[key], "false"))
    false = share(groups[worst], "false")
    _, strength, motion, method = worst
    where = f"{motion}, `{method}`" if len(strengths) == 1 else f"{strength}, {motion}, `{method}`"
    tail = f"at most {percent(false)} ({where})" if false > 0.0 else "none at all"
    return f"Right frames{order}: {'; '.join(curves)}. False ones: {tail}."


COLUMNS: dict[str, Callable[[Sequence[Row]], str]] = {
    "error [mm]": lambda rows: _median(rows, "rms_tracked.position_mm", "{:.2f}"),
    "right": lambda rows: percent(share(rows, "right")),
    "tracking": lambda rows: percent(share(rows, "says_so")),
    "false": lambda rows: percent(share(rows, "false")),
    "missed": lambda rows: percent(share(rows, "missed")),
    "longest": lambda rows: _longest(rows),
    "recover": lambda rows: _recover(rows),
}


def table(rows: Sequence[Row], group: str) -> str:
    """The table of one group, with the undisturbed lines first, if they were run."""
    members = select(rows, group=group)
    names = list(COLUMNS)
    if not any(row["recovery.recovered"] is not None for row in members):
        names.remove("recover")
    lines: list[list[object]] = []
    for motion in MOTIONS:
        shown = select(members, motion=motion)
        base = select(rows, group="none", motion=motion) if group != "none" else []
        for strength in dict.fromkeys(row["strength"] for row in [*base, *shown]):
            of = base if strength == "-" and base else shown
            cells: list[object] = [motion, "none" if strength == "-" else strength]
            for method in METHODS:
                seeds = select(of, strength=strength, method=method)
                cells += [COLUMNS[name](seeds) if seeds else "-" for name in names]
            lines.append(cells)
    header = ["motion", "strength", *(f"{m} {name}" for m in METHODS for name in names)]
    return markdown(header, lines)


def _median(rows: Sequence[Row], name: str, form: str) -> str:
    known = [row[name] for row in rows if row[name] is not None]
    return form.format(np.median(known)) if known else "-"


def _longest(rows: Sequence[Row]) -> str:
    known = [row["recovery.longest_wrong"] for row in rows]
    known = [value for value in known if value is not None]
    return f"{np.median(known):g} ({max(known)})" if known else "-"


def _recover(rows: Sequence[Row]) -> str:
    ended = [row for row in rows if row["recovery.recovered"] is not None]
    if not ended:
        return "-"
    frames = [row["recovery.after_outage"] for row in ended]
    never = sum(value is None for value in frames)
    median = float(np.median([math.inf if value is None else value for value in frames]))
    text = "endless" if math.isinf(median) or math.isnan(median) else f"{median:g}"
    return f"{text} ({never})" if never else text
