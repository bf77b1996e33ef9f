"""Accuracy of whole simulations, with and without refinement: path, shaking hand, random starts."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from mffdrake.experiment.runs.executors.local_processes import LocalProcesses
from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.poses.pose import rotation_angle

SHAKING = Path(__file__).parents[2] / "scenarios" / "shaking_hand.yaml"
SEEDS = {"flat": 20, "vtk": 5}
FIRST_SEED = 500  # apart from those that the parameters were tuned on
OMEGAS = (0.105, 0.157, 0.314, 1.256)
REFINEMENTS = ("none", "borders")
SETTLED_AFTER = 5.0
LOCK_FRAMES = 60


def measure(file: str | None, text: str) -> dict[str, float]:
    """One run's errors, settled, and whether it was right from some frame on."""
    result = Simulate(LoadScenario(file, text))
    error = 1e3 * (result.recognized_pose - result.true_pose)[:, :3]
    turn = np.degrees(rotation_angle(result.true_pose[:, 3:], result.recognized_pose[:, 3:]))
    distance = np.linalg.norm(error, axis=1)
    settled = result.time >= SETTLED_AFTER
    near = (distance < 5.0) & (turn < 1.0)
    values = {"locked": float(np.all(near[LOCK_FRAMES - 5 : LOCK_FRAMES]))}
    if settled.any():
        values |= {
            "position": float(np.sqrt(np.mean(distance[settled] ** 2))),
            "rotation": float(np.sqrt(np.mean(turn[settled] ** 2))),
            "bias": float(np.linalg.norm(error[settled].mean(axis=0))),
            "within": float(np.mean(near[settled])),
        }
        values |= {
            axis: float(np.sqrt(np.mean(error[settled, k] ** 2))) for k, axis in enumerate("xyz")
        }
    return values


def run_all(arguments: list[tuple[str | None, str]]) -> list[dict[str, Any]]:
    """All runs, on all cores."""
    results: dict[int, dict[str, Any]] = {}
    with LocalProcesses() as executor:
        for outcome in tqdm(executor.Run(measure, arguments), total=len(arguments), unit="run"):
            if outcome.exception is not None:
                raise outcome.exception
            results[outcome.index] = outcome.value
    return [results[k] for k in range(len(arguments))]


def median(runs: Iterable[dict[str, Any]], name: str) -> float:
    """Median over the seeds."""
    return float(np.median([run[name] for run in runs]))


def path_table() -> str:
    """Errors along the paper's path."""
    # VTK's images take ten times as long, so they confirm the refined errors only.
    variants = [("flat", o, f) for f in REFINEMENTS for o in OMEGAS]
    variants += [("vtk", o, "borders") for o in OMEGAS]
    arguments = [
        (None, f"{{renderer: {renderer}, seed: {FIRST_SEED + k}, hand_path: {{omega: {omega}}}, "
         f"recognizer: {{refinement: {refinement}}}}}")
        for renderer, omega, refinement in variants for k in range(SEEDS[renderer])
    ]  # fmt: skip
    results, rows, slow = iter(run_all(arguments)), [], {}
    for renderer, omega, refinement in variants:
        runs = [next(results) for _ in range(SEEDS[renderer])]
        position = median(runs, "position")
        slow.setdefault((renderer, refinement), position)
        numbers = [f"{median(runs, name):.3f}" for name in ("x", "y", "z", "position", "rotation")]
        ratio = f"{position / slow[renderer, refinement]:.2f}"
        bias = f"{median(runs, 'bias'):.3f}"
        rows.append([renderer, omega, refinement, len(runs), ratio, *numbers, bias])
    header = ["renderer", "omega [rad/s]", "refinement", "seeds", "position / at 0.105 rad/s"]
    header += ["x [mm]", "y [mm]", "z [mm]", "position [mm]", "rotation [deg]", "bias [mm]"]
    return Markdown(header, rows)


def shake_table(seeds: int = 5) -> str:
    """The shaking hand."""
    variants = [(p, m, f) for p in (0.033, 0.132) for m in ("mff", "ga") for f in REFINEMENTS]
    arguments = [
        (str(SHAKING), f"{{renderer: flat, method: {method}, seed: {FIRST_SEED + k}, "
         f"timing: {{vision_period: {period}}}, "
         f"recognizer: {{refinement: {refinement}, start: near_target}}}}")
        for period, method, refinement in variants for k in range(seeds)
    ]  # fmt: skip
    results, rows = iter(run_all(arguments)), []
    for period, method, refinement in variants:
        runs = [next(results) for _ in range(seeds)]
        frames = "every" if period == 0.033 else "every fourth"
        numbers = [f"{median(runs, name):.2f}" for name in ("position", "rotation")]
        within = f"{100 * median(runs, 'within'):.1f} %"
        rows.append([frames, method, refinement, seeds, within, *numbers])
    header = ["frames", "method", "refinement", "seeds", "within 5 mm and 1 deg"]
    return Markdown([*header, "position [mm]", "rotation [deg]"], rows)


def lock_table(seeds: int = 60) -> str:
    """Random starts."""
    arguments = [
        (None, f"{{renderer: flat, duration: 2.0, seed: {FIRST_SEED + k}, "
         f"hand_path: {{omega: 0.314}}, recognizer: {{refinement: {refinement}}}}}")
        for refinement in REFINEMENTS for k in range(seeds)
    ]  # fmt: skip
    results = run_all(arguments)
    rows = []
    for k, refinement in enumerate(REFINEMENTS):
        share = np.mean([run["locked"] for run in results[k * seeds : (k + 1) * seeds]])
        rows.append([refinement, seeds, f"{100 * share:.0f} %"])
    return Markdown(["refinement", "seeds", f"within 5 mm and 1 deg at frame {LOCK_FRAMES}"], rows)
