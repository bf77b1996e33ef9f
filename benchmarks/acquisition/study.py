# ruff: noqa: E501 (text)
"""How fast and surely a target is found from nothing: writes docs/studies/acquisition.md.

    python benchmarks acquisition [--poses 300] [--workers 2] [--only CASE ...]

With 300 poses it takes about three quarters of an hour on two cores.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from processes import call_all

from acquisition.cases import ANYWHERE, SOLIDS, Case, Renderer, disturb
from mffdrake.experiment.runs.store import CodeFingerprint
from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import Change, Scenario
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition import (
    RefinementParameters,
    RobustTracker,
    TrackerParameters,
)
from mffdrake.recognition.genetic.generation import Generation
from mffdrake.recognition.poses.pose import pose_from_transform, rotation_angle, transform_from_pose
from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.solid.symmetry import Symmetries, find_symmetries
from mffdrake.recognition.tracking.confidence import RIGHT_POSITION, RIGHT_ROTATION

Array = NDArray[np.float64]

SEED = 7000  # apart from those that the parameters were tuned on
SHOWN = (1, 2, 3, 10)
CHUNK = 20  # poses a task
TOGETHER: dict[str, Any] = {"blobs": 10, "hidden": 0.4, "noise": 5.0, "frames": 10}

CASES = (
    Case(name="box"),
    Case(name="box, 10 blobs", blobs=10),
    Case(name="box, 320 x 240", width=320),
    Case(name="box, noise of 5 levels", noise=5.0),
    Case(name="box, partly out of one image", partly=True),
    Case(name="box, one camera", cameras=1),
    *(Case(name=name, solid=name) for name in SOLIDS if name != "box"),
    *(Case(name=f"{name}, 10 blobs", solid=name, blobs=10) for name in SOLIDS if name != "box"),
    Case(name="six-colored box, any orientation", solid="six-colored box", search_range=ANYWHERE),
    *(Case(name=f"{name}, 40 % hidden", solid=name, hidden=0.4) for name in SOLIDS),
    Case(
        name="six-colored box, any orientation, 40 % hidden", solid="six-colored box",
        search_range=ANYWHERE, hidden=0.4,
    ),
    *(Case(name=f"{name}, all together", solid=name, **TOGETHER) for name in SOLIDS),
    Case(
        name="six-colored box, any orientation, all together", solid="six-colored box",
        search_range=ANYWHERE, **TOGETHER,
    ),
)  # fmt: skip

PAGE = """# Found from nothing

Written by `python benchmarks acquisition --poses {poses}`. Code: {code}.

A tracker with `recognizer: {{refinement: borders}}` is shown a target at {poses} random poses of its search range, nothing of which it knows. *Right* is the share of poses recognized to 5 mm and 1 deg at the first, second, third and tenth frame [%]; *says so* the share with `is_tracking` at the third, *false* the share of all frames that say so of a wrong pose. At rest all frames show the same pose; on the path the cameras swing as the hand does on the paper's path at 0.314 rad/s, from a random moment on, and feedforward tells the tracker of it.

*Blobs* are discs and polygons of 8 to 50 pixels in the target's own colors, behind it. *Hidden*: a bar, grey or of a hue that the target lacks, lies over this share of the target's pixels in each image, on a random side. *All together*: ten blobs, 40 % hidden, and noise of 5 levels. Poses are right where the target can be told at all: a bar may hide all of a target but one face, and a face turned by a half may look the same. (The box's half turns, which change nothing that is to be seen, count as right.)

{tables}"""


class Outcome(NamedTuple):
    """Of poses and frames, shape (poses, frames): errors, and what is said of them."""

    position: Array
    rotation: Array
    says: NDArray[np.bool_]

    @property
    def right(self) -> NDArray[np.bool_]:
        """Which poses are right."""
        return (self.position <= RIGHT_POSITION) & (self.rotation <= RIGHT_ROTATION)


def swings() -> tuple[Array, Array]:
    """How the rig moves from frame to frame on the path: its last pose in the present one."""
    scenario = Change(Scenario(), {"renderer": "flat", "duration": 14.0, "hand_path.omega": 0.314})
    R, p = transform_from_pose(Simulate(scenario).true_pose)
    R_DC = R[1:] @ np.swapaxes(R[:-1], 1, 2)
    return R_DC, p[1:] - np.einsum("kij,kj->ki", R_DC, p[:-1])


class Frame(NamedTuple):
    """What a tracker made of a frame: of which pose and which one it is, and errors."""

    number: int
    time_step: int
    generation: Generation
    position: float
    rotation: float


def make_tracker(case: Case, seed: int = 0) -> RobustTracker:
    """The tracker that a case's poses are shown to."""
    parameters = TrackerParameters(
        refinement=RefinementParameters(), search_range=case.search_range
    )
    tracker = parameters.make_tracker(solid=case.solid_model, rig=case.rig, seed=seed)
    assert isinstance(tracker, RobustTracker)  # as poses are refined
    return tracker


def errors(pose: Array, true: Array, symmetries: Symmetries) -> tuple[float, float]:
    """Distance [m] and angle [rad], modulo turns that change nothing that is to be seen."""
    alike = symmetries.nearest(true, pose)
    angle = rotation_angle(alike[3:], pose[3:])
    return float(np.linalg.norm(pose[:3] - alike[:3])), float(angle)


def show(
    case: Case, renderer: str, motion: tuple[Array, Array] | None, seed: int, poses: range
) -> Iterator[Frame]:
    """Shows some of a case's poses to a tracker."""
    draw = Renderer(case, renderer)
    symmetries = find_symmetries(case.solid_model)
    for n in poses:
        rng = np.random.default_rng([seed, n])
        true = case.draw_pose(rng)
        tracker = make_tracker(case, seed=n)
        begin = 0 if motion is None else int(rng.integers(len(motion[0]) - case.frames))
        pictures, generation = draw(true), None
        for k in range(case.frames):
            if generation is not None and motion is not None:
                R_DC, p_DC = motion[0][begin + k], motion[1][begin + k]
                R, p = transform_from_pose(true)
                true = pose_from_transform(R_DC @ R, R_DC @ p + p_DC)
                generation = generation.carried(R_DC, p_DC)
                pictures = draw(true)
            if k == 0 or motion is not None or case.noise:
                images = disturb(pictures, case, [seed, n], k)
            if generation is None:
                generation = tracker.start_population(images, frame=0)
            else:
                generation = tracker.track(generation, images, frame=k)
            yield Frame(n, k, generation, *errors(generation.best, true, symmetries))


def find(
    case: Case, renderer: str, motion: tuple[Array, Array] | None, first: int, count: int
) -> Outcome:
    """How it went with some of a case's poses."""
    shape = (count, case.frames)
    outcome = Outcome(*(np.zeros(shape, dtype=t) for t in (float, float, bool)))
    for frame in show(case, renderer, motion, SEED, range(first, first + count)):
        at = frame.number - first, frame.time_step
        outcome.position[at], outcome.rotation[at] = frame.position, frame.rotation
        outcome.says[at] = frame.generation.is_tracking
    return outcome


def study(options: argparse.Namespace) -> dict[tuple[str, str, str], Outcome]:
    """All cases, by renderer, motion and name."""
    cases = [case for case in CASES if not options.only or case.name in options.only]
    moving = swings()
    starts = range(0, options.poses, CHUNK)
    tasks, keys = [], []
    for renderer, name, case, first in itertools.product(
        options.renderers, options.motions, cases, starts
    ):
        count = min(CHUNK, options.poses - first)
        tasks.append((case, renderer, moving if name == "path" else None, first, count))
        keys.append((renderer, name, case.name))
    parts = call_all(find, tasks, keys, "acquisition", options.workers)
    found: dict[tuple[str, str, str], Outcome] = {}
    for key in dict.fromkeys(keys):
        of = [part for part, other in zip(parts, keys, strict=True) if other == key]
        found[key] = Outcome(*(np.concatenate(fields) for fields in zip(*of, strict=True)))
    return found


def table(found: dict[str, Outcome]) -> str:
    """Shares of the poses by case."""
    heads = ["case", *(f"right, {k}" for k in SHOWN), "says so, 3", "false, any"]
    rows: list[list[object]] = []
    for name, outcome in found.items():
        right, says = outcome.right, outcome.says
        shares = [right[:, k - 1].mean() if k <= right.shape[1] else math.nan for k in SHOWN]
        shares += [says[:, 2].mean(), (says & ~right).mean()]
        rows.append([name, *("-" if math.isnan(s) else f"{100 * s:.1f}" for s in shares)])
    return Markdown(heads, rows)


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=300, help="random poses of each case")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--renderers", nargs="+", default=["flat", "vtk"])
    parser.add_argument("--motions", nargs="+", default=["rest", "path"], choices=["rest", "path"])
    parser.add_argument("--only", nargs="+", default=[], choices=[c.name for c in CASES])
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[2] / "docs" / "studies")
    options = parser.parse_args()
    found = study(options)
    where = {"rest": "at rest", "path": "on the path at 0.314 rad/s, with feedforward"}
    tables = []
    for renderer, name in itertools.product(options.renderers, options.motions):
        of = {key[2]: outcome for key, outcome in found.items() if key[:2] == (renderer, name)}
        tables.append(f"## {renderer} images, {where[name]}\n\n{table(of)}")
    print("\n\n".join(tables))
    if options.only:
        return
    page = PAGE.format(poses=options.poses, code=CodeFingerprint(), tables="\n\n".join(tables))
    with WholeFile(options.docs / "acquisition.md") as part:
        part.write_text(page + "\n", encoding="utf-8")
    print(f"\nwritten: {options.docs / 'acquisition.md'}")
