"""Frames of many runs and cases, and what weights make of them."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from acquisition.study import CASES
from numpy.typing import NDArray
from processes import call_all
from studies.robustness_conditions import MOTIONS, conditions, motion
from studies.robustness_page import METHODS, TEXTS

from confidence.evidence import Judged, of_run, of_wrong_optima
from mffdrake.experiment.scenario.scenario import Change

Array = NDArray[np.float64]

TRAINING_SEED, CHECK_SEED = 2000, 3000
POSES = 20  # of each of the acquisition study's cases, a seed and a renderer
RENDERERS = ("flat", "vtk")


@dataclass(frozen=True)
class Frames:
    """Frames with the state TRACKING: their features, whether the poses are right, of which run.

    And the names of the runs' conditions, and the number of frames of all states.
    """

    features: Array
    right: NDArray[np.bool_]
    run: NDArray[np.int64]
    names: list[str]
    total: int

    @classmethod
    def of(cls, parts: Sequence[Judged], names: list[str]) -> Frames:
        """The frames of several runs with names."""
        rows, right, totals = zip(*parts, strict=True)
        run = np.repeat(np.arange(len(right)), [len(one) for one in right])
        return cls(np.concatenate(rows), np.concatenate(right), run, names, sum(totals))

    def confidence(self, weights: Array) -> Array:
        """What the weights make of the frames, shape (K,)."""
        return logistic(self.features, weights)


def of_study(options: argparse.Namespace, first_seed: int, title: str) -> Frames:
    """The frames of all conditions' runs with seeds from a first one on."""
    groups = options.only or TEXTS
    chosen = [c for c in conditions(options.duration) if c[0] in groups]
    scenarios, names = [], []
    seeds = range(first_seed, first_seed + options.seeds)
    for (group, strength, changes), name, method, seed in itertools.product(
        chosen, MOTIONS, METHODS, seeds
    ):
        base = Change(motion(name, options.duration), changes)
        scenarios.append((Change(base, {"method": method, "seed": seed}),))
        label = f"{group}, {strength}".removesuffix(", -")
        names.append(f"{label} ({name}, `{method}`)")
    return Frames.of(call_all(of_run, scenarios, names, title), names)


def of_images(
    function: Callable[..., Judged], options: argparse.Namespace, seed: int, title: str
) -> Frames:
    """What a function judges of poses of the acquisition study's cases, with each renderer."""
    cases = [case for case in CASES if case.hidden or function is of_wrong_optima]
    shown = list(itertools.product(cases, RENDERERS))
    tasks = [(case, renderer, seed, range(POSES * options.seeds)) for case, renderer in shown]
    names = [f"{case.name} ({renderer})" for case, renderer in shown]
    return Frames.of(call_all(function, tasks, names, title), names)


def logistic(rows: Array, weights: Array) -> Array:
    """The confidence that weights make of features, shape (K,)."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(rows @ weights, -500.0, 500.0))))
