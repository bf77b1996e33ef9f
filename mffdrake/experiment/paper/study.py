"""Named groups of labeled scenarios, the plan that they come to, and what came out."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mffdrake.experiment.runs.engine import EndedRun, PlannedRun, RunPlan
from mffdrake.experiment.runs.executors.executors import Executor
from mffdrake.experiment.runs.store import STORE_NAME, RunStore
from mffdrake.experiment.runs.table import Group, GroupRows, Quartiles
from mffdrake.experiment.scenario.scenario import METHODS, LoadScenario, Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.recordings.files import MakeOutputFolder
from mffdrake.systems.arms.hand_path import HandPath

__all__ = [
    "At", "AtRest", "FindGroup", "PlanRuns", "QuartilesOf", "Reproduction", "RunStudies", "Study",
    "Summarize", "Table", "Variant",
]  # fmt: skip

_RECORDED = "near"  # The study whose first seed is kept frame by frame, for Fig. 6 and 7.


@dataclass(frozen=True)
class Variant:
    """One line of a study.

    Attributes:
        label: What people call it.
        curve: Variants of the same curve are joined in a plot.
        value: Where on the curve it is, in the study's unit.
        changes: Scenario texts (YAML), each on top of the one before and all on top of the rest.

    Example:
        >>> gray = Variant("Gray code", "gray", 1.0, ("recognizer: {coding: gray}", "duration: 10"))
        >>> study = Study("coding", "Coding", "Does it matter?", "coding [-]", (gray,), seeds=1)
        >>> run = PlanRuns([study], Scenario())[0]
        >>> run.scenario.recognizer.coding, run.scenario.duration
        ('gray', 10.0)
    """

    label: str
    curve: str
    value: float
    changes: tuple[str, ...]


@dataclass(frozen=True)
class Study:
    """A question, and the variants that answer it.

    Attributes:
        name: Identifier.
        title: Heading.
        question: What it shows, in a sentence or two.
        axis: What a variant's ``value`` is, with its unit.
        variants: See `Variant`.
        seeds: Number of seeds.

    Example:
        >>> variants = Table("duration: 10", omegas=[0.1, 0.2], methods=["ga", "mff"])
        >>> study = Study("short", "Short runs", "Is 10 s enough?", "omega", variants, seeds=3)
        >>> len(PlanRuns([study], Scenario()))
        12
    """

    name: str
    title: str
    question: str
    axis: str
    variants: tuple[Variant, ...]
    seeds: int


def At(method: str, omega: float) -> str:
    """A scenario text: a method at a speed of the hand's path [rad/s]."""
    return f"{{method: {method}, hand_path: {{omega: {omega!r}}}}}"


def Table(
    *changes: str, omegas: Sequence[float], methods: Sequence[str] = METHODS
) -> tuple[Variant, ...]:
    """Variants: methods x speeds [rad/s], with changes."""
    return tuple(
        Variant(f"{method}, {omega:g} rad/s", method, omega, (At(method, omega), *changes))
        for method in methods
        for omega in omegas
    )


def AtRest(place: str, share: float) -> Variant:
    """A camera at rest: a path without speed, which the arm starts on and never leaves.

    Args:
        place: What people call the place.
        share: Where it is: the angle on the path as a share of its amplitude, -1 to 1.
    """
    # With omega = 1 rad/s the path's phase is the time.
    X_WE0 = HandPath(omega=1.0).CalcHandPose(math.asin(share))
    theta_deg = round(math.degrees(HandPath().amplitude) * share, 9)
    x, y, z = (float(value) for value in X_WE0.translation())
    # Roll, pitch, yaw of Eq. (29), turned about the vertical.
    pose = (
        f"{{translation: [{x!r}, {y!r}, {z!r}], "
        f"rotation: !Rpy {{deg: [-90, 0, {-90.0 + theta_deg!r}]}}}}"
    )
    moved = (f"hand_path: {{X_WE0: {pose}}}",) if share else ()
    changes = ("{method: ga, hand_path: {omega: 0}}", *moved)
    return Variant(f"fixed, {place}", "fixed", theta_deg, changes)


def PlanRuns(studies: Sequence[Study], base: Scenario) -> tuple[PlannedRun, ...]:
    """All runs of some studies.

    Args:
        studies: The studies.
        base: What their scenarios are on top of; it has the first seed. Its method, renderer and
            speed do not count, as each variant has its own.

    Returns:
        Each study's variants, each with each seed, labeled by ``study``, ``label``, ``curve`` and
        ``value``. Several may be of the same scenario.

    Raises:
        ScenarioError: When a scenario is wrong.

    Example:
        >>> gray = Variant("gray", "a", 0, ("recognizer: {coding: gray}",))
        >>> run = PlanRuns([Study("a", "A", "?", "b", (gray,), seeds=2)], Scenario(seed=7))[-1]
        >>> run.scenario.seed, run.scenario.renderer, run.scenario.recognizer.coding
        (8, 'flat', 'gray')
    """
    runs = []
    flat = dc.replace(base, renderer="flat")
    for study in studies:
        for variant in study.variants:
            scenario = flat
            for text in variant.changes:
                scenario = LoadScenario(text=text, defaults=scenario)
            labels = {"study": study.name, "label": variant.label, "curve": variant.curve,
                      "value": variant.value}  # fmt: skip
            for seed in range(base.seed, base.seed + study.seeds):
                run = PlannedRun(
                    scenario=dc.replace(scenario, seed=seed), labels=labels,
                    keeps_frames=study.name == _RECORDED and seed == base.seed,
                    may_be_unreachable=True,
                )  # fmt: skip
                runs.append(run)
    return tuple(runs)


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """What came out of some studies.

    Attributes:
        studies: What was run.
        rows: One for each of their runs, in order, see `EndedRun.Row`.
        records: Of the first seed from a start near the target: frames by (method, omega [rad/s]).

    Example:
        >>> rows = ({"seed": 0, "status": "done"}, {"seed": 1, "status": "failed"})
        >>> [row["seed"] for row in Reproduction(studies=(), rows=rows, records={}).Failures()]
        [1]
    """

    studies: tuple[Study, ...]
    rows: tuple[dict[str, Any], ...]
    records: dict[tuple[str, float], SimulationResult]

    def Failures(self) -> list[dict[str, Any]]:
        """The rows of the runs that failed, other than for the arm's limits."""
        return [row for row in self.rows if row["status"] == "failed"]


def RunStudies(
    studies: Sequence[Study],
    base: Scenario,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    on_run: Callable[[EndedRun], None] | None = None,
) -> Reproduction:
    """Runs studies, except for what the folder has from before; see `RunPlan`.

    Args:
        studies: The studies.
        base: See `PlanRuns`.
        folder: The folder, which is made where there is none.
        executor: Where to run; processes of this machine, one a core, by default.
        on_run: Called for every distinct run that has ended.

    Returns:
        What came out. A run that failed is a row with its error, tried again next time.

    Raises:
        ScenarioError: When a scenario is wrong.
        StoreError: When the folder's store cannot be used.
        ClusterError: When the cluster cannot be reached (any more).
    """
    plan, store = PlanRuns(studies, base), RunStore(MakeOutputFolder(folder) / STORE_NAME)
    ended = RunPlan(plan, store, executor=executor, on_run=on_run)
    records = {
        (one.run.labels["curve"], one.run.labels["value"]): one.frames
        for one in ended if one.frames is not None
    }  # fmt: skip
    return Reproduction(
        studies=tuple(studies), rows=tuple(one.Row() for one in ended), records=records
    )


def Summarize(rows: Sequence[dict[str, Any]]) -> list[Group]:
    """Groups of the runs that differ in their seeds alone.

    Args:
        rows: See `Reproduction`.

    Returns:
        A group for each study's variant, in order.

    Example:
        >>> variant = {"study": "near", "label": "mff, 0.1 rad/s", "curve": "mff", "value": 0.1}
        >>> rows = [{**variant, "seed": k, "mean_fitness": 0.8} for k in range(3)]
        >>> [group.Quartiles("mean_fitness").median for group in Summarize(rows)]
        [0.8]
    """
    return GroupRows(rows, ("study", "label", "curve", "value"))


def FindGroup(summary: Sequence[Group], study: str, curve: str, value: float) -> Group | None:
    """The group of a study's variant; None when there is none.

    Args:
        summary: See `Summarize`.
        study: The study's name.
        curve: The variant's curve.
        value: The variant's value.
    """
    wanted = {"study": study, "curve": curve, "value": value}
    return next((group for group in summary if wanted.items() <= group.labels.items()), None)


def QuartilesOf(group: Group | None, cell: str, window: str) -> Quartiles | None:
    """A figure's quartiles over the seeds; None where there is no number.

    Args:
        group: See `FindGroup`.
        cell: ``mean_fitness`` or one of `RMS_ERRORS`.
        window: ``all`` frames, or ``settled``: those after the first seconds.

    Example:
        >>> QuartilesOf(None, "x_mm", "all") is None
        True
    """
    suffix = "_settled" if window == "settled" else ""
    name = f"{cell}{suffix}" if cell == "mean_fitness" else f"rms{suffix}.{cell}"
    return None if group is None else group.Quartiles(name)
