"""How well a recognition went: errors, mean fitness, tables, medians over seeds."""

from __future__ import annotations

import csv
import json
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.scenario.scenario_sections import NoServo
from mffdrake.experiment.simulation.recovery import CalcRecovery, OutageEnd
from mffdrake.experiment.simulation.servo_evaluation import EvaluateServo
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.parameters import kind_of
from mffdrake.recognition.poses.pose import pose_errors, rotation_angle
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.tracking.confidence import RIGHT_POSITION, RIGHT_ROTATION

__all__ = [
    "RMS_ERRORS",
    "SETTLED_AFTER",
    "TRACKING_SHARES",
    "Evaluate",
    "FlattenRow",
    "IsRight",
    "MarkdownTable",
    "Medians",
    "Versions",
    "WriteCsv",
    "WriteResults",
]

SETTLED_AFTER = 5.0
"""Settled figures leave out the frames before this time [s]: a random start costs some frames."""

RMS_ERRORS = ("x_mm", "y_mm", "z_mm", "eps1", "eps2", "eps3", "position_mm", "rotation_deg")
"""Names of the root-mean-square errors: position [mm], quaternion [-], distance, angle."""

TRACKING_SHARES = ("right", "says_so", "false", "missed")
"""Shares of the frames: whose pose is right, which say so (``is_tracking``), and where these
differ: those that say so of a wrong pose, and those that do not of a right one."""

_PACKAGES = ("mffdrake", "drake", "numpy", "numba")


def Evaluate(result: SimulationResult) -> dict[str, Any]:
    """One row of ``results.json``.

    Args:
        result: A simulation's record.

    Returns:
        Method, omega, seed, mean fitness, root-mean-square errors over all frames and over those
        after the first `SETTLED_AFTER` seconds (None where there are none), shares of the frames
        (see `TRACKING_SHARES`), errors of those that the tracker calls good, frames without the
        target (see `CalcRecovery`), in servoing what `EvaluateServo` tells, and times.

    Example:
        >>> from mffdrake.experiment.simulation.simulation import Simulate
        >>> scenario = LoadScenario(text="{duration: 0.1, camera: {width: 64, height: 48}}")
        >>> Evaluate(Simulate(scenario))["frames"]
        4
    """
    scenario = LoadScenario(text=result.scenario)
    settled = result.time >= SETTLED_AFTER
    everything = np.ones_like(settled)
    return {
        "method": scenario.method,
        "omega": scenario.hand_path.omega,
        "seed": scenario.seed,
        "start": scenario.recognizer.start,
        "coding": scenario.recognizer.coding,
        "refinement": kind_of(type(scenario.recognizer.refinement)),
        "renderer": scenario.renderer,
        "duration": scenario.duration,
        "frames": len(result.time),
        "mean_fitness": _MeanFitness(result, everything),
        "mean_fitness_settled": _MeanFitness(result, settled),
        "rms": _RmsErrors(result, everything),
        "rms_settled": _RmsErrors(result, settled),
        "tracking": _TrackingShares(result),
        "rms_tracked": _RmsErrors(result, _SaysSo(result)),
        "recovery": CalcRecovery(result.time, IsRight(result), OutageEnd(scenario)),
        **({} if isinstance(scenario.servo, NoServo) else EvaluateServo(result, scenario)),
        "wall_s": result.wall_s,
        "realtime_factor": scenario.duration / result.wall_s,
        "stages_ms": result.stages_ms,
        "symmetries": result.symmetries,
    }


def _MeanFitness(result: SimulationResult, chosen: NDArray[np.bool_]) -> float | None:
    return float(result.fitness[chosen].mean()) if chosen.any() else None


def _RmsErrors(result: SimulationResult, chosen: NDArray[np.bool_]) -> dict[str, float | None]:
    """Root-mean-square errors of the chosen frames."""
    error = (result.recognized_pose - result.true_pose)[chosen]
    angle = rotation_angle(result.true_pose[chosen, 3:], result.recognized_pose[chosen, 3:])
    columns = (
        *(1e3 * error[:, :3].T),
        *error[:, 3:].T,
        1e3 * np.linalg.norm(error[:, :3], axis=1),
        np.degrees(angle),
    )
    return {
        name: float(np.sqrt(np.mean(values**2))) if len(values) else None
        for name, values in zip(RMS_ERRORS, columns, strict=True)
    }


def IsRight(result: SimulationResult) -> NDArray[np.bool_]:
    """Which frames' poses are right: to 5 mm and 1 deg, shape (K,).

    Args:
        result: A simulation's record.
    """
    distances, angles = pose_errors(result.true_pose, result.recognized_pose)
    return (distances <= RIGHT_POSITION) & (angles <= RIGHT_ROTATION)


def _SaysSo(result: SimulationResult) -> NDArray[np.bool_]:
    """Which frames' poses the tracker calls good, shape (K,)."""
    return result.is_tracking == 1.0


def _TrackingShares(result: SimulationResult) -> dict[str, float]:
    right, says_so = IsRight(result), _SaysSo(result)
    frames = (right, says_so, says_so & ~right, right & ~says_so)
    return {
        name: float(np.mean(chosen)) for name, chosen in zip(TRACKING_SHARES, frames, strict=True)
    }


def Medians(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians over the seeds, one row for each speed and method, in order of appearance.

    Args:
        rows: Rows of `Evaluate`.

    Returns:
        Rows with ``method``, ``omega``, ``seeds`` (their number) and the medians of
        ``mean_fitness``, ``mean_fitness_settled``, ``rms``, ``rms_settled``, ``realtime_factor``.
    """
    groups: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["method"], row["omega"]), []).append(row)
    medians = []
    for (method, omega), members in groups.items():
        summary: dict[str, Any] = {"method": method, "omega": omega, "seeds": len(members)}
        for name in ("mean_fitness", "mean_fitness_settled", "realtime_factor"):
            summary[name] = _Median([row[name] for row in members])
        for name in ("rms", "rms_settled"):
            summary[name] = {
                key: _Median([row[name][key] for row in members]) for key in members[0][name]
            }
        medians.append(summary)
    return medians


def _Median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def MarkdownTable(rows: Sequence[dict[str, Any]]) -> str:
    """A table of medians over the seeds, as Markdown.

    Args:
        rows: Rows of `Evaluate`.

    Returns:
        The table. Errors are root-mean-square values of the frames after the first `SETTLED_AFTER`
        seconds, or of all frames where the runs are shorter.
    """
    settled = all(row["mean_fitness_settled"] is not None for row in rows)
    fitness, rms = ("mean_fitness_settled", "rms_settled") if settled else ("mean_fitness", "rms")
    header = (
        "omega [rad/s]", "method", "seeds", "fitness", "x [mm]", "y [mm]", "z [mm]",
        "eps1", "eps2", "eps3", "position [mm]", "rotation [deg]", "real-time factor",
    )  # fmt: skip
    lines = [f"| {' | '.join(header)} |", f"|{'---:|' * len(header)}"]
    for row in Medians(rows):
        errors = row[rms]
        cells = [f"{row['omega']:g}", row["method"], str(row["seeds"]), f"{row[fitness]:.3f}"]
        cells += [f"{errors[key]:.2f}" for key in ("x_mm", "y_mm", "z_mm")]
        cells += [f"{errors[key]:.4f}" for key in ("eps1", "eps2", "eps3")]
        cells += [f"{errors['position_mm']:.2f}", f"{errors['rotation_deg']:.2f}"]
        cells += [f"{row['realtime_factor']:.2f}"]
        lines.append(f"| {' | '.join(cells)} |")
    frames = (
        f"the frames after the first {SETTLED_AFTER:g} s"
        if settled
        else f"all frames with the search at the start, for want of {SETTLED_AFTER:g} s"
    )
    lines += ["", f"Medians over the seeds; mean fitness and root-mean-square errors of {frames}."]
    return "\n".join(lines)


def Versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


def WriteResults(rows: Sequence[dict[str, Any]], folder: Path, *, as_csv: bool = False) -> None:
    """Writes ``results.json`` and, on request, ``results.csv``, each whole or not at all.

    Args:
        rows: Rows of `Evaluate`.
        folder: An existing folder.
        as_csv: Whether to write the CSV file, one line a run, nested names joined by dots.

    Raises:
        OSError: When a file cannot be written.
    """
    with WholeFile(folder / "results.json") as part:
        data = {"runs": list(rows), "versions": Versions()}
        part.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    if as_csv:
        WriteCsv(rows, folder / "results.csv")


def WriteCsv(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes rows as CSV, whole or not at all: one line a row, nested names joined by dots.

    Args:
        rows: Rows of `Evaluate`, or of others; a figure that a row lacks is left empty.
        path: The file.

    Raises:
        OSError: When it cannot be written.
    """
    flat = [FlattenRow(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    with WholeFile(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=names)
        writer.writeheader()
        writer.writerows(flat)


def FlattenRow(row: dict[str, Any]) -> dict[str, Any]:
    """A row without nested mappings: their names are joined by dots.

    Args:
        row: A row of `Evaluate`.

    Returns:
        Its figures.

    Example:
        >>> FlattenRow({"frames": 4, "rms": {"x_mm": 0.5}})
        {'frames': 4, 'rms.x_mm': 0.5}
    """
    flat = {}
    for key, value in row.items():
        if isinstance(value, dict):
            flat.update({f"{key}.{name}": item for name, item in value.items()})
        else:
            flat[key] = value
    return flat
