"""The page of the robustness study: every number in it is read off the runs."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from studies.robustness_conditions import MOTIONS

from mffdrake.experiment.runs.table import GroupRows, Markdown, SummaryTable

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

Tables have medians over the seeds, of shares means:

- *fitness*, *position* and *rotation*: mean fitness, and root-mean-square errors of all frames;
  *tracked*: of the position, over the frames whose pose the tracker calls good (`is_tracking`).
- *right*: share of the frames whose pose is within 5 mm and 1 deg of the truth.
- *tracking*: share of the frames whose pose the tracker calls good.
- *false*: share of the frames whose pose it calls good although it is not right.
- *missed*: share of the frames whose pose it does not call good although it is right. A pose that
  is carried along by the feedforward while nothing can be seen counts here too.
- *longest*: the longest stretch of frames that are not right, after the first right one.
- *recover*: frames from the end of the outage to the first right one, 0 where the pose is right at
  once, of the runs that have one.

Shares count every frame, those of the search at the start too. The
lines *none* of the tables are the undisturbed runs of the same seeds."""


TEXTS = {
    "none": (
        "Nothing is disturbed."
    ),
    "motion blur": (
        "The shutter is open for so long before each frame (`MotionBlur`). The true pose is "
        "that at its end, so a blurred target lies behind it by half the exposure."
    ),
    "noise": (
        "Normal noise of every channel of every pixel (`GaussianNoise`)."
    ),
    "salt and pepper": (
        "Pixels that are white or black (`SaltAndPepper`)."
    ),
    "brightness": (
        "All levels are multiplied by a gain that swings about 1 by so much, once in a run "
        "(`Brightness`)."
    ),
    "color temperature": (
        "The gains of red and blue swing in opposite directions by so much, once in a run "
        "(`ColorTemperature`)."
    ),
    "occluder": (
        "A grey plate passes 0.3 m in front of the target, from 30 % to 70 % of the run "
        "(`Occluder`). The widest one hides the whole target in both images for a while; the "
        "frames to recover count from when it has come to rest beside the target."
    ),
    "hidden": (
        "A grey plate stands 0.3 m in front of the target all the time. Seen from the hand's "
        "place at rest, it hides this share of the target's pixels, its lower part, in both "
        "images."
    ),
    "distractors": (
        "Spheres and cubes of 3 cm in the target's own colors fly about behind it "
        "(`Distractors`)."
    ),
    "dropped frames": (
        "Each camera shows its last image again, with this probability (`DroppedFrames`). "
        "Where both do, the images are good ones, but of the frame before: only what is known"
        " of the motion can tell."
    ),
    "late frames": (
        "Each camera's image is one or two frames late, with this probability, and then "
        "mostly in one camera alone (`LateFrames`)."
    ),
    "left and right out of step": (
        "The left camera's image is one frame late, with this probability; the right one's "
        "never (`LateFrames`). At 100 % the cameras are a frame apart all the time. The right"
        " one is the reference: its time is that of the true pose."
    ),
    "frozen images": (
        "Both cameras show the same images for so long, from 30 % of the run on (`Frozen`). "
        "The images are good ones, but of an earlier moment: only what is known of the motion"
        " can tell, and `ga` knows nothing of it."
    ),
    "black images": (
        "Both cameras' images are black for so long, from 30 % of the run on (`Black`)."
    ),
    "encoder noise": (
        "Normal noise of every joint angle that controller and feedforward read, another one "
        "every tick (`encoders.noise_deg`)."
    ),
    "encoder offset": (
        "Every joint angle is off by so much, by turns in either direction "
        "(`encoders.offset_deg`)."
    ),
    "hand-eye error": (
        "The feedforward takes the cameras to be turned and shifted by so much about and "
        "along every axis (`predictor.hand_eye_error_deg` and `hand_eye_error`)."
    ),
    "focal error": (
        "The recognizer takes the cameras' focal lengths to be longer by so much "
        "(`calibration.focal_error`). The target then seems farther away by the same share, "
        "by its size as by its disparity, so that the images hardly contradict it."
    ),
    "baseline error": (
        "The recognizer takes the left camera to be farther from the right one by so much "
        "(`calibration.baseline_error`)."
    ),
    "out of view": (
        "The cameras sit higher on the hand (or farther to the left), so that this share of "
        "the target, seen from the hand's place at rest, is beyond the lower edge of both "
        "images (or the right edge of the left image alone)."
    ),
    "all together": (
        "The weakest strength of each group at once, without frozen and black images, with the "
        "whole target in view and no plate that stands before it."
    ),
}  # fmt: skip


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
    for group, text in TEXTS.items():
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
    return Markdown(["motion", "method", "frames", "right", "tracking", "false", "missed"], lines)


def _groups(rows: Sequence[Row]) -> dict[tuple[str, str, str, str], list[Row]]:
    """The seeds' rows of each group, strength, motion and method, in order of appearance."""
    by = ("group", "strength", "motion", "method")
    return {tuple(group.labels.values()): group.rows for group in GroupRows(rows, by)}


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
    never = sum(row["recovery.recovered"] is False for found in groups.values() for row in found)
    lost = f" In {never} runs it is not found again." if never else ""
    return f"Right frames{order}: {'; '.join(curves)}. False ones: {tail}.{lost}"


MORE = ("rms_tracked.position_mm", "recovery.longest_wrong", "recovery.after_outage")


def table(rows: Sequence[Row], group: str) -> str:
    """The table of one group, with the undisturbed lines first, if they were run."""
    members = select(rows, group=group)
    base = [{**row, "strength": "none"} for row in rows if row["group"] == "none"]
    lines = [
        row for motion in MOTIONS
        for row in select([*(base if group != "none" else []), *members], motion=motion)
    ]  # fmt: skip
    return SummaryTable(lines, ("motion", "strength", "method"), more=MORE)
