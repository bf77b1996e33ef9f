# ruff: noqa: E501 (text)
"""How well the solids in models/ are tracked, and found: writes docs/studies/targets.md.

    python benchmarks targets [--seeds 20] [--poses 100] [--only NAME ...]

With 20 seeds and 100 poses it takes about half an hour on two cores.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from processes import call_all

from acquisition.cases import MODELS, Case
from acquisition.study import find
from mffdrake.experiment.runs.store import CodeFingerprint
from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import Change, LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition import CameraRig, Matcher, SearchModel, SolidModel
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.solid import disk_cache
from mffdrake.recognition.solid.symmetry import find_symmetries

ROOT = Path(__file__).parents[2]
NAMES = ("target_box", "wedge", "hexagonal_prism", "l_block", "notched_box", "hammer", "mug")
FIRST_SEED = 8000  # apart from those that anything was tuned on
SETTLED_AFTER = 1.0  # [s]
TRIES = 15
POSES = 400

PAGE = """# Targets of all kinds

Written by `python benchmarks targets --seeds {seeds} --poses {poses}`. Code: {code}.

## On the paper's path

The hand swings at 0.314 rad/s for 20 s, with feedforward and `refinement: borders`, flat images, {seeds} seeds: RMS errors from {settled:g} s on, over all seeds and of the worst one, and the share of frames with `is_tracking`. Errors are those of the pose that looks the same and is nearest to the true one.

{path}

## Found from nothing

Share of {poses} random poses of the search range that are recognized to 5 mm and 1 deg at frames 1, 3 and 10 [%], at rest, without noise; *false*: share of all frames that say `is_tracking` of a wrong pose. With one camera it is the same poses in the left image alone.

{found}

## What they cost

Building what the recognizer needs to know of a solid, which is kept on disk from then on, and reading it [s]; and the fitness of one pose against the box's, measured in turns in one process.

{cost}
"""


def _path(model: str, seed: int) -> dict[str, Any]:
    """Errors of one run on the paper's path [mm, deg]."""
    file = ROOT / "scenarios" / "targets" / f"{model}.yaml"
    text = "{hand_path: {omega: 0.314}, recognizer: {refinement: borders}}"
    scenario = LoadScenario(file) if file.exists() else LoadScenario(text=text)
    run = Simulate(Change(scenario, {"seed": seed, "renderer": "flat", "duration": 20.0}))
    settled = run.time >= SETTLED_AFTER
    error = (run.recognized_pose - run.true_pose)[settled]
    angle = rotation_angle(run.true_pose[settled, 3:], run.recognized_pose[settled, 3:])
    return {
        "position": 1e3 * float(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=1)))),
        "rotation": math.degrees(float(np.sqrt(np.mean(angle**2)))),
        "tracking": float(run.is_tracking[settled].mean()),
    }


def path_table(models: list[str], seeds: int) -> str:
    """All models on the paper's path."""
    tasks = [(model, FIRST_SEED + k) for model in models for k in range(seeds)]
    values = call_all(_path, tasks, tasks, "on the path")
    rows: list[list[object]] = []
    for model in models:
        of = [v for v, (name, _) in zip(values, tasks, strict=True) if name == model]
        position, rotation = ([v[k] for v in of] for k in ("position", "rotation"))
        rms = [math.sqrt(float(np.mean(np.square(v)))) for v in (position, rotation)]
        symmetries = find_symmetries(MODELS[f"models/{model}"])
        tracking = 100 * float(np.mean([v["tracking"] for v in of]))
        rows.append(
            [model, str(symmetries), f"{rms[0]:.3f}", f"{max(position):.3f}", f"{rms[1]:.3f}",
             f"{max(rotation):.3f}", f"{tracking:.2f}"]
        )  # fmt: skip
    heads = [
        "target",
        "symmetries",
        "position [mm]",
        "worst",
        "rotation [deg]",
        "worst",
        "tracking [%]",
    ]
    return Markdown(heads, rows)


def found_table(models: list[str], poses: int) -> str:
    """All models, found from nothing."""
    chunk = 20
    cases = [
        Case(name=f"{m}, {words}", solid=f"models/{m}", cameras=count, frames=10)
        for m in models
        for count, words in ((2, "two cameras"), (1, "one camera"))
    ]
    tasks = [
        (case, "flat", None, first, min(chunk, poses - first))
        for case in cases
        for first in range(0, poses, chunk)
    ]
    outcomes = call_all(find, tasks, [task[0].name for task in tasks], "found")
    rows: list[list[object]] = []
    for case in cases:
        of = [o for o, task in zip(outcomes, tasks, strict=True) if task[0] == case]
        right = np.concatenate([o.right for o in of])
        says = np.concatenate([o.says for o in of])
        shares = [right[:, k - 1].mean() for k in (1, 3, 10)] + [(says & ~right).mean()]
        rows.append([case.name, *(f"{100 * share:.1f}" for share in shares)])
    return Markdown(["target", "right, 1", "right, 3", "right, 10", "false, any"], rows)


def _poses() -> NDArray[np.float64]:
    """Random poses of all orientations."""
    rng = np.random.default_rng(0)
    q = rng.normal(size=(POSES, 4))
    q *= (np.sign(q[:, 0]) / np.linalg.norm(q, axis=1))[:, None]
    places = np.column_stack([rng.uniform(-0.05, 0.05, (POSES, 2)), rng.uniform(0.5, 0.8, POSES)])
    return np.hstack([places, q[:, 1:]])


def cost_table(models: list[str]) -> str:
    """What building and comparing costs, beside the box."""
    rig, rng, poses = CameraRig.stereo(), np.random.default_rng(1), _poses()
    images = [
        rng.integers(0, 256, (camera.height, camera.width, 3), dtype=np.uint8)
        for camera in rig.cameras
    ]
    solids = {name: MODELS[f"models/{name}"] for name in ("target_box", *models)}
    solids["bumpy ball"] = _ball()
    matchers: dict[str, Matcher] = {}
    building: dict[str, list[float]] = {name: [] for name in solids}
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
        disk_cache.disk_memory.cache_clear()
        for name in ("target_box", "mug"):  # After that all is compiled.
            Matcher(SearchModel(MODELS[f"models/{name}"]), rig).fitness(poses, images)
        shutil.rmtree(folder)
        disk_cache.disk_memory.cache_clear()
        for name, solid in 2 * [*solids.items()]:
            start = time.perf_counter()
            matchers[name] = Matcher(SearchModel(solid), rig)
            matchers[name].fitness(poses, images)
            building[name].append(time.perf_counter() - start)
    disk_cache.disk_memory.cache_clear()
    best = dict.fromkeys(matchers, math.inf)
    for _ in range(TRIES):
        for name, matcher in matchers.items():
            scene = matcher.scene(images)
            start = time.perf_counter()
            matcher.score(poses, scene)
            best[name] = min(best[name], time.perf_counter() - start)
    rows: list[list[object]] = [
        [name, len(solids[name].triangles), *(f"{t:.2f}" for t in building[name]),
         f"{1e6 * best[name] / POSES:.1f}", f"{best[name] / best['target_box']:.2f}"]
        for name in matchers
    ]  # fmt: skip
    return Markdown(
        ["target", "triangles", "built [s]", "read [s]", "a pose [us]", "of the box's"], rows
    )


def _ball() -> SolidModel:
    """A bumpy ball in three colors, of 10 000 triangles."""
    import trimesh

    mesh = trimesh.creation.uv_sphere(radius=0.08, count=[50, 50])
    triangles = np.asarray(mesh.triangles)
    ways = triangles / np.linalg.norm(triangles, axis=-1, keepdims=True)
    bumps = 1.0 + 0.1 * np.cos(3.0 * ways[..., 0] + 1.0) * np.sin(4.0 * ways[..., 1])
    triangles = triangles * bumps[..., None]
    x, y, _ = triangles.mean(axis=1).T
    third = (np.arctan2(y, x) * 1.5 / math.pi).astype(int) % 3
    names = [("red", "green", "blue")[k] for k in third]
    return SolidModel.from_triangles(triangles, 2.0 * math.pi / 3.0 * third, names)


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="runs of each target on the path")
    parser.add_argument("--poses", type=int, default=100, help="random poses of each target")
    parser.add_argument("--only", nargs="+", default=list(NAMES), choices=NAMES)
    parser.add_argument("--docs", type=Path, default=ROOT / "docs" / "studies")
    options = parser.parse_args()
    page = PAGE.format(
        seeds=options.seeds, poses=options.poses, code=CodeFingerprint(), settled=SETTLED_AFTER,
        cost=cost_table(options.only), path=path_table(options.only, options.seeds),
        found=found_table(options.only, options.poses),
    )  # fmt: skip
    print(page)
    if options.only != list(NAMES):
        return
    with WholeFile(options.docs / "targets.md") as part:
        part.write_text(page, encoding="utf-8")
    print(f"written: {options.docs / 'targets.md'}")
