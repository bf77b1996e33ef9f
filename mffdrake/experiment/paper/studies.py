"""What the reproduction of the paper's experiment runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from mffdrake.experiment.runs.study import Study, Variant
from mffdrake.experiment.scenario.scenario import ScenarioError
from mffdrake.systems.arms.hand_path import HandPath

__all__ = [
    "FEW_SEEDS",
    "PAPER_OMEGAS",
    "PLAIN_GA",
    "MakeStudies",
]

PAPER_OMEGAS = (0.105, 0.157, 0.314)
"""The paper's angular frequencies of the hand's path [rad/s]."""

FEW_SEEDS = 5
"""The studies beyond the paper's table have at most so many seeds."""

PLAIN_GA = """
recognizer:
  survivor_share: 0.5
  local_share: 0
  newcomer_share: 0
  first_candidates: 1
  average_best: false
  start: near_target
  sampling: {margin: null, strip_offsets: [0.006]}
  matching: {min_border_distance: 0, min_cosine: 0.02}
"""
"""The paper's own GA, as a scenario text: survivors and crossover children alone, its points."""

_FRAME = 0.033  # s
_FAST = PAPER_OMEGAS[-1]
_NEAR = "{recognizer: {start: near_target}}"
_REFINED = "{recognizer: {refinement: borders}}"
_METHODS = ("ga", "mff")
_STARTS = {"near_target": "near the target", "random": "from a random first population"}


def MakeStudies(seeds: int = 20, *, vtk_seeds: int = 5, short: bool = False) -> tuple[Study, ...]:
    """The studies.

    Args:
        seeds: Number of seeds of the paper's table; the others have at most `FEW_SEEDS`.
        vtk_seeds: Number of seeds of the same table on VTK's images; 0 leaves it out.
        short: Whether to make do with one seed, the flat renderer, and some of the variants.

    Returns:
        The studies, the paper's own table first.

    Raises:
        ScenarioError: When a number of seeds is out of range.

    Example:
        >>> [study.name for study in MakeStudies(2, vtk_seeds=0)][:3]
        ['near', 'random', 'fixed']
        >>> sum(len(study.variants) * study.seeds for study in MakeStudies(short=True))
        31
    """
    if seeds < 1 or vtk_seeds < 0:
        raise ScenarioError(
            f"seeds must be at least 1 and vtk_seeds at least 0, not {seeds} and {vtk_seeds}"
        )
    if short:
        seeds, vtk_seeds = 1, 0
    few = min(seeds, FEW_SEEDS)
    studies = [*_Tables(seeds, vtk_seeds), _Fixed(few, short), *_OfTheGa(few, short)]
    studies += _OfTheRefinement(few, short)
    studies += [*_OfTheFeedforward(few, short), *([] if short else [_Faster(few)])]
    return tuple(studies)


def _At(method: str, omega: float) -> str:
    return f"{{method: {method}, hand_path: {{omega: {omega!r}}}}}"


def _Table(
    *changes: str, methods: Sequence[str] = _METHODS, omegas: Sequence[float] = PAPER_OMEGAS
) -> tuple[Variant, ...]:
    """Methods x speeds, with changes."""
    return tuple(
        Variant(
            label=f"{method}, {omega:g} rad/s",
            curve=method,
            value=omega,
            changes=(_At(method, omega), *changes),
        )
        for method in methods
        for omega in omegas
    )


def _Tables(seeds: int, vtk_seeds: int) -> Iterator[Study]:
    speed = "omega [rad/s]"
    yield Study(
        name="near", title="From a first population near the target",
        question="The paper's errors leave no room for a search at the start, so its runs began "
        "near the truth; so do these.",
        axis=speed, variants=_Table(_NEAR), seeds=seeds,
    )  # fmt: skip
    yield Study(
        name="random", title="From a random first population",
        question="The search starts anywhere within the search range and first has to find the "
        "target, which the figures over 0-40 s include.",
        axis=speed, variants=_Table("{recognizer: {start: random}}"), seeds=seeds,
    )  # fmt: skip
    for name, start in (("vtk_near", "near_target"), ("vtk", "random")) if vtk_seeds else ():
        yield Study(
            name=name, title=f"On VTK's images, {_STARTS[start]}",
            question="The same with VTK's renderer in place of the flat one.",
            axis=speed, seeds=vtk_seeds,
            variants=_Table(f"{{renderer: vtk, recognizer: {{start: {start}}}}}"),
        )  # fmt: skip


def _Fixed(seeds: int, short: bool) -> Study:
    """The camera at rest: a path without speed, which the arm starts on and never leaves."""
    path = HandPath()
    variants = []
    for place, angle in (("middle", 0.0), ("right end", 1.0), ("left end", -1.0)):
        t = math.asin(angle)  # With omega = 1 rad/s the path's phase is the time.
        X_WE0 = HandPath(omega=1.0).CalcHandPose(t)
        theta_deg = round(math.degrees(path.amplitude) * angle, 9)
        x, y, z = (float(value) for value in X_WE0.translation())
        # Roll, pitch, yaw of Eq. (29), turned about the vertical.
        pose = (
            f"{{translation: [{x!r}, {y!r}, {z!r}], "
            f"rotation: !Rpy {{deg: [-90, 0, {-90.0 + theta_deg!r}]}}}}"
        )
        changes = ["{method: ga, hand_path: {omega: 0}}"]
        if angle:
            changes.append(f"hand_path: {{X_WE0: {pose}}}")
        variants.append(
            Variant(label=f"fixed, {place}", curve="fixed", value=theta_deg, changes=tuple(changes))
        )
    return Study(
        name="fixed", title="A fixed camera",
        question="The limit that the paper compares itself with: the hand rests at the start of "
        "the path, or at one of its ends, where the feedforward has nothing to do.",
        axis="angle on the path [deg]", variants=tuple(variants[:1] if short else variants),
        seeds=seeds,
    )  # fmt: skip


def _OfTheGa(seeds: int, short: bool) -> Iterator[Study]:
    omegas = (_FAST,) if short else PAPER_OMEGAS
    yield Study(
        name="plain", title="The paper's plain GA",
        question="Half of the population survives, the rest are crossover children; one row of "
        "strip points; start near the target: what the paper describes and no more.",
        axis="omega [rad/s]", variants=_Table(PLAIN_GA), seeds=seeds,
    )  # fmt: skip
    yield Study(
        name="gray", title="Gray coding",
        question="Genes in Gray code instead of the paper's plain binary code.",
        axis="omega [rad/s]",
        variants=_Table("{recognizer: {coding: gray}}", omegas=omegas), seeds=seeds,
    )  # fmt: skip
    if not short:
        yield Study(
            name="generations", title="More generations a frame",
            question="How much of the feedforward's gain could computing time buy instead?",
            axis="generations a frame", seeds=seeds,
            variants=tuple(
                Variant(
                    label=f"{method}, {count} a frame", curve=method, value=count,
                    changes=(
                        _At(method, _FAST),
                        f"{{recognizer: {{generations_per_frame: {count}}}}}",
                    ),
                )
                for method in _METHODS for count in (1, 3, 9)
            ),
        )  # fmt: skip


def _OfTheRefinement(seeds: int, short: bool) -> Iterator[Study]:
    question = (
        "Beyond the paper: every frame's pose is refined to parts of a pixel, by the color borders "
        "in both images."
    )
    omegas = PAPER_OMEGAS if short else (*PAPER_OMEGAS, 4 * _FAST)
    methods = ("mff",) if short else _METHODS
    yield Study(
        name="refined", title="With sub-pixel refinement", question=question, axis="omega [rad/s]",
        variants=_Table(_REFINED, methods=methods, omegas=omegas), seeds=seeds,
    )  # fmt: skip
    if short:
        return
    variants = tuple(
        Variant(
            label=f"{frames} frames, {curve}",
            curve=curve,
            value=float(frames),
            changes=(
                _At("mff", _FAST),
                _REFINED,
                f"{{camera: {{latency: {frames * _FRAME:.3f}}}, predictor: {{latency: {known}}}}}",
            ),
        )
        for curve, known in (("reckoned with", "null"), ("ignored", "0.0"))
        for frames in (0, 3, 6)
    )
    yield Study(
        name="refined_latency", title="Camera latency, with sub-pixel refinement",
        question=f"{question} With feedforward at {_FAST:g} rad/s.",
        axis="camera latency [frames]", variants=variants, seeds=seeds,
    )  # fmt: skip


def _OfTheFeedforward(seeds: int, short: bool) -> Iterator[Study]:
    if not short:
        yield Study(
            name="velocity", title="Velocity mode",
            question="The hypotheses carried along by pose rate times frame time, Eq. (12), "
            "instead of the exact rigid displacement.",
            axis="omega [rad/s]", seeds=seeds,
            variants=_Table("{predictor: {mode: velocity}}", methods=("mff",)),
        )  # fmt: skip
    latency = [
        (f"latency {frames}, {how}", how, frames,
         f"{{camera: {{latency: {frames * _FRAME:.3f}}}, predictor: {{latency: {known}}}}}")
        for frames in ((3,) if short else range(7))
        for how, known in (("known", "null"), ("ignored", "0.0"))
    ]  # fmt: skip
    gains = (0.5,) if short else (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
    gain = [(f"gain {g:g}", "mff", g, f"{{predictor: {{gain: {g}}}}}") for g in gains]
    hand_eye = [
        (f"{angle} deg about {axis}", axis, angle,
         f"{{predictor: {{hand_eye_error_deg: {[float(angle * (axis == a)) for a in 'xyz']}}}}}")
        for axis in "xyz" for angle in ((5,) if short else range(6))
    ]  # fmt: skip
    noises = (0.05,) if short else (0.0, 0.005, 0.01, 0.02, 0.05, 0.1)
    noise = [(f"noise {n:g} deg", "mff", n, f"{{encoders: {{noise_deg: {n}}}}}") for n in noises]
    for name, title, question, axis, lines in (
        ("latency", "Late images", "Images that arrive late, by whole frames, when the feedforward "
         "reckons with their age (known) and when it does not (ignored).",
         "camera latency [frames]", latency),
        ("gain", "Feedforward gain", "Only a share of the hand's motion is fed forward, or more "
         "than all of it.", "gain", gain),
        ("hand_eye", "Hand-eye calibration", "The orientation of the cameras on the hand, as it is "
         "known, is wrong by a rotation about one axis of the hand.",
         "rotation error [deg]", hand_eye),
        ("noise", "Encoder noise", "Every joint angle that the controller and the feedforward read "
         "has an error, another one every millisecond.", "standard deviation [deg]", noise),
    ):  # fmt: skip
        variants = tuple(
            Variant(label=label, curve=curve, value=value, changes=(_At("mff", _FAST), change))
            for label, curve, value, change in lines
        )
        yield Study(
            name=name, title=title, question=f"{question} With feedforward at {_FAST:g} rad/s.",
            axis=axis, variants=variants, seeds=seeds,
        )  # fmt: skip


def _Faster(seeds: int) -> Study:
    return Study(
        name="faster", title="Twice and four times the speed",
        question="Beyond the paper's fastest path, as far as the joints allow. The arm swings the "
        "more; its swing can carry the target out of the search range at first.",
        axis="omega [rad/s]", variants=_Table(omegas=(2 * _FAST, 4 * _FAST)), seeds=seeds,
    )  # fmt: skip
