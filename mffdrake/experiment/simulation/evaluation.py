"""How well a recognition went: the columns of every table of results, one line each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.scenario.scenario_sections import ServoConfig
from mffdrake.experiment.simulation.recovery import (
    RECOVERY,
    CalcHandErrors,
    CalcRecovery,
    FindLoss,
    OutageEnd,
)
from mffdrake.experiment.simulation.simulation import STAGES, SimulationResult
from mffdrake.recognition.parameters import kind_of
from mffdrake.recognition.poses.pose import pose_errors, rotation_angle
from mffdrake.recognition.tracking.confidence import RIGHT_POSITION, RIGHT_ROTATION

__all__ = [
    "COLUMNS",
    "RMS_ERRORS",
    "SETTLED_AFTER",
    "Column",
    "Evaluate",
    "Evidence",
    "FlattenRow",
    "IsRight",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED_AFTER = 5.0
"""Settled figures leave out the frames before this time [s]: a random start costs some frames."""

_HAND_SETTLED_AFTER = 10.0  # [s] A hand that follows takes longer.

RMS_ERRORS = ("x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3", "position_mm", "rotation_deg")
"""Names of the root-mean-square errors: position [mm], quaternion [-], distance, angle."""


class Evidence:
    """A simulation's record, and what its columns are computed from.

    Args:
        result: The record, of K frames.
    """

    def __init__(self, result: SimulationResult) -> None:
        self.result = result
        self.scenario = LoadScenario(text=result.scenario)

    @property
    def all(self) -> Mask:
        """All frames, shape (K,)."""
        return np.ones(len(self.result.time), dtype=bool)

    def since(self, time: float) -> Mask:
        """The frames from a time on [s], shape (K,)."""
        return self.result.time >= time

    @cached_property
    def right(self) -> Mask:
        """Which frames' poses are right, see `IsRight`, shape (K,)."""
        return IsRight(self.result)

    @property
    def says_so(self) -> Mask:
        """Which frames' poses the tracker calls good, shape (K,)."""
        return self.result.is_tracking == 1.0

    @cached_property
    def recovery(self) -> dict[str, Any]:
        """See `CalcRecovery`."""
        return CalcRecovery(self.result.time, self.right, OutageEnd(self.scenario))

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Errors of the recognized poses by the names of `RMS_ERRORS`, each of shape (K,)."""
        true, found = self.result.true_pose, self.result.recognized_pose
        error = found - true
        angle = rotation_angle(true[:, 3:], found[:, 3:])
        columns = (
            *(1e3 * error[:, :3].T), *error[:, 3:].T,
            1e3 * np.linalg.norm(error[:, :3], axis=1), np.degrees(angle),
        )  # fmt: skip
        return dict(zip(RMS_ERRORS, columns, strict=True))

    @cached_property
    def hand_errors(self) -> tuple[Array, Array]:
        """Errors of a hand that follows [m], [rad], each of shape (K,), see `CalcHandErrors`."""
        return CalcHandErrors(self.result, self.scenario)


class Column(NamedTuple):
    """A figure of a run, and how tables show it.

    Attributes:
        name: Its key in rows; dots separate nested mappings.
        kind: Its type; None where a run has no such figure is always possible.
        calc: Computes it.
        title: Its heading in tables for people, with the unit.
        form: How they format it, see `format`.
        shown: Whether every table for people shows it.
        settled: The name of the same figure of settled frames, which tables prefer; empty for none.
        is_mean: Whether seeds are summed up by their mean instead of their median, as shares are.
        needs_servo: Whether only runs that servo have it.
    """

    name: str
    kind: type
    calc: Callable[[Evidence], Any]
    title: str = ""
    form: str = ""
    shown: bool = False
    settled: str = ""
    is_mean: bool = False
    needs_servo: bool = False


def _Rms(values: Array, chosen: Mask) -> float | None:
    """Root mean square of the chosen frames; None where there are none."""
    return float(np.sqrt(np.mean(values[chosen] ** 2))) if chosen.any() else None


def _MeanFitness(run: Evidence, chosen: Mask) -> float | None:
    return float(run.result.fitness[chosen].mean()) if chosen.any() else None


def _Errors(
    section: str,
    chosen: Callable[[Evidence], Mask],
    *,
    prefix: str = "",
    settled: str = "",
    shown: bool = False,
) -> Iterator[Column]:
    """A column for each of `RMS_ERRORS`, of the chosen frames."""
    for error in RMS_ERRORS:
        yield Column(
            f"{section}.{error}", float, partial(_RmsError, error=error, chosen=chosen),
            title=prefix + (error.replace("_", " [") + "]" if "_" in error else error),
            form=".4f" if error.startswith("eps") else ".2f",
            shown=shown and error in ("position_mm", "rotation_deg"),
            settled=settled and f"{settled}.{error}",
        )  # fmt: skip


def _HandErrors(
    section: str, since: float, *, settled: str = "", shown: bool = False
) -> Iterator[Column]:
    """Root-mean-square errors of a hand that follows, of the frames from a time on [s]."""
    for k, (error, unit, scale) in enumerate(
        (("position_mm", "mm", 1e3), ("rotation_deg", "deg", math.degrees(1.0)))
    ):
        yield Column(
            f"{section}.{error}", float,
            partial(_HandRms, which=k, scale=scale, since=since),
            title=f"hand [{unit}]", form=".2f", shown=shown,
            settled=settled and f"{settled}.{error}", needs_servo=True,
        )  # fmt: skip


def _RmsError(run: Evidence, *, error: str, chosen: Callable[[Evidence], Mask]) -> float | None:
    return _Rms(run.errors[error], chosen(run))


def _HandRms(run: Evidence, *, which: int, scale: float, since: float) -> float | None:
    value = _Rms(run.hand_errors[which], run.since(since))
    return None if value is None else scale * value


def _Recovery(run: Evidence, *, name: str) -> Any:
    return run.recovery[name]


def _Stage(run: Evidence, *, name: str) -> float:
    return run.result.stages_ms[name]


COLUMNS: tuple[Column, ...] = (
    Column("method", str, lambda run: run.scenario.method),
    Column("omega", float, lambda run: run.scenario.hand_path.omega),
    Column("seed", int, lambda run: run.scenario.seed),
    Column("start", str, lambda run: run.scenario.recognizer.start),
    Column("coding", str, lambda run: run.scenario.recognizer.coding),
    Column("refinement", str, lambda run: kind_of(type(run.scenario.recognizer.refinement))),
    Column("renderer", str, lambda run: run.scenario.renderer),
    Column("duration", float, lambda run: run.scenario.duration),
    Column("frames", int, lambda run: len(run.result.time)),
    Column("mean_fitness", float, lambda run: _MeanFitness(run, run.all), "fitness", ".3f",
           shown=True, settled="mean_fitness_settled"),
    Column("mean_fitness_settled", float, lambda run: _MeanFitness(run, run.since(SETTLED_AFTER))),
    *_Errors("rms", lambda run: run.all, shown=True, settled="rms_settled"),
    *_Errors("rms_settled", lambda run: run.since(SETTLED_AFTER)),
    # Shares of frames: whose pose is right; which say so (``is_tracking``); which say so of a
    # wrong pose; which do not of a right one.
    Column("tracking.right", float, lambda run: float(np.mean(run.right)), "right", ".2%",
           shown=True, is_mean=True),
    Column("tracking.says_so", float, lambda run: float(np.mean(run.says_so)), "tracking", ".2%",
           shown=True, is_mean=True),
    Column("tracking.false", float, lambda run: float(np.mean(run.says_so & ~run.right)), "false",
           ".2%", shown=True, is_mean=True),
    Column("tracking.missed", float, lambda run: float(np.mean(run.right & ~run.says_so)), "missed",
           ".2%", shown=True, is_mean=True),
    *_Errors("rms_tracked", lambda run: run.says_so, prefix="tracked "),
    *(Column(f"recovery.{name}", kind, partial(_Recovery, name=name), title, ".3g")
      for name, (kind, title) in RECOVERY.items()),
    *_HandErrors("hand_rms", 0.0, shown=True, settled="hand_rms_settled"),
    *_HandErrors("hand_rms_settled", _HAND_SETTLED_AFTER),
    Column("lost_s", float, lambda run: FindLoss(run.result), needs_servo=True),
    Column("wall_s", float, lambda run: run.result.wall_s),
    Column("realtime_factor", float, lambda run: run.scenario.duration / run.result.wall_s,
           "real-time factor", ".2f", shown=True),
    *(Column(f"stages_ms.{stage}", float, partial(_Stage, name=stage))
      for stage in STAGES),
    Column("symmetries", str, lambda run: run.result.symmetries),
)  # fmt: skip
"""All figures of a run. What is added here is in every row and every file, and where it is shown,
in every table."""


def Evaluate(result: SimulationResult) -> dict[str, Any]:
    """One row of ``results.json``.

    Args:
        result: A simulation's record.

    Returns:
        The `COLUMNS` that it has; names with dots are nested mappings. Among them are mean fitness,
        root-mean-square errors over all frames and over those after the first `SETTLED_AFTER`
        seconds (None where there are none), shares of the frames, errors of those that the tracker
        calls good, frames without the target (see `CalcRecovery`), in servoing the hand's errors
        and when the target was lost, and times.

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> scenario = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> Evaluate(Simulate(scenario))["frames"]
        4
    """
    run = Evidence(result)
    servoes = isinstance(run.scenario.servo, ServoConfig)
    row: dict[str, Any] = {}
    for column in COLUMNS:
        if servoes or not column.needs_servo:
            *sections, name = column.name.split(".")
            inner = row
            for section in sections:
                inner = inner.setdefault(section, {})
            inner[name] = column.calc(run)
    return row


def FlattenRow(row: dict[str, Any]) -> dict[str, Any]:
    """A row without nested mappings: their names are joined by dots.

    Args:
        row: A row of `Evaluate`.

    Returns:
        Its figures, by the names of `COLUMNS`.

    Example:
        >>> FlattenRow({"frames": 4, "rms": {"x_mm": 0.5}})
        {'frames': 4, 'rms.x_mm': 0.5}
    """
    flat = {}
    for key, value in row.items():
        nested = value if isinstance(value, dict) else None
        flat.update(
            {key: value} if nested is None else {f"{key}.{k}": v for k, v in nested.items()}
        )
    return flat


def IsRight(result: SimulationResult) -> Mask:
    """Which frames' poses are right: to 5 mm and 1 deg, shape (K,)."""
    distances, angles = pose_errors(result.true_pose, result.recognized_pose)
    return (distances <= RIGHT_POSITION) & (angles <= RIGHT_ROTATION)
