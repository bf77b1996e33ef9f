"""Named groups of labeled scenarios, and the runs that they come to."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from dataclasses import dataclass

from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario

__all__ = ["PlanRuns", "PlannedRun", "Study", "Variant"]

_VTK_WORK = 12.0  # Times as long as with the flat renderer, on two cores without a GPU.


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One line of a study.

    Attributes:
        label: What people call it.
        curve: Variants of the same curve are joined in a plot.
        value: Where on the curve it is, in the study's unit.
        changes: Scenario texts (YAML), each on top of the one before and all on top of the rest.
    """

    label: str
    curve: str
    value: float
    changes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Study:
    """A question, and the variants that answer it.

    Attributes:
        name: Identifier.
        title: Heading.
        question: What it shows, in a sentence or two.
        axis: What a variant's ``value`` is, with its unit.
        variants: See `Variant`.
        seeds: Number of seeds.
    """

    name: str
    title: str
    question: str
    axis: str
    variants: tuple[Variant, ...]
    seeds: int


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """One run of a study.

    Attributes:
        study: The study.
        variant: Which of its variants.
        seed: The seed.
        scenario: The scenario.
    """

    study: Study
    variant: Variant
    seed: int
    scenario: Scenario

    @property
    def work(self) -> float:
        """About how much longer it takes than a run with the flat renderer."""
        return _VTK_WORK if self.scenario.renderer == "vtk" else 1.0


def PlanRuns(studies: Sequence[Study], base: Scenario) -> tuple[PlannedRun, ...]:
    """All runs of some studies.

    Args:
        studies: The studies.
        base: What their scenarios are on top of; it has the first seed. Its method, renderer and
            speed do not count, as each variant has its own.

    Returns:
        Each study's variants, each with each seed. Several may be of the same scenario.

    Raises:
        ScenarioError: When a scenario is wrong.

    Example:
        >>> text = "recognizer: {coding: gray}"
        >>> gray = Variant(label="gray", curve="a", value=0, changes=(text,))
        >>> study = Study(name="a", title="A", question="?", axis="b", variants=(gray,), seeds=2)
        >>> run = PlanRuns([study], Scenario(seed=7))[-1]
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
            for seed in range(base.seed, base.seed + study.seeds):
                seeded = dc.replace(scenario, seed=seed)
                runs.append(PlannedRun(study=study, variant=variant, seed=seed, scenario=seeded))
    return tuple(runs)
