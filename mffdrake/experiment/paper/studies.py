"""The plan of the paper's experiment and of the studies beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mffdrake.experiment.paper.study import At, AtRest, Study, Table, Variant
from mffdrake.experiment.scenario.scenario import METHODS, ScenarioError
from mffdrake.recognition.parameters.yaml_text import ReadYaml

__all__ = ["FEW_SEEDS", "PAPER_OMEGAS", "PLAIN_GA", "MakeStudies"]

PAPER_OMEGAS = (0.105, 0.157, 0.314)
"""The paper's angular frequencies of the hand's path [rad/s]."""

FEW_SEEDS = 5
"""The studies beyond the paper's table have at most so many seeds."""

PLAIN_GA = """
recognizer: {
  survivor_share: 0.5, local_share: 0, newcomer_share: 0, first_candidates: 1, average_best: false,
  start: near_target, sampling: {margin: null, strip_offsets: [0.006]},
  matching: {min_border_distance: 0, min_cosine: 0.02}}
"""
"""The paper's own GA, as a scenario text: survivors and crossover children alone, its points."""

_FRAME, _FAST = 0.033, PAPER_OMEGAS[-1]
_REFINED, _VTK, _MFF = "recognizer: {refinement: borders}", "renderer: vtk", At("mff", _FAST)


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
        wanted = "seeds must be at least 1 and vtk_seeds at least 0"
        raise ScenarioError(f"{wanted}, not {seeds} and {vtk_seeds}")
    seeds, vtk_seeds = (1, 0) if short else (seeds, vtk_seeds)
    few, paper = min(seeds, FEW_SEEDS), PAPER_OMEGAS
    latencies = (("known", "null"), ("ignored", "0.0"))
    studies = {
        "near": (seeds, Table("{recognizer: {start: near_target}}", omegas=paper)),
        "random": (seeds, Table("{recognizer: {start: random}}", omegas=paper)),
        "vtk_near": (vtk_seeds, Table(_VTK, "{recognizer: {start: near_target}}", omegas=paper)),
        "vtk": (vtk_seeds, Table(_VTK, "{recognizer: {start: random}}", omegas=paper)),
        "fixed": (few, [AtRest("middle", 0), AtRest("right end", 1), AtRest("left end", -1)]),
        "plain": (few, Table(PLAIN_GA, omegas=paper)),
        "gray": (few, Table("{recognizer: {coding: gray}}", omegas=paper)),
        "generations": (few, [
            Variant(f"{method}, {n} a frame", method, n,
                    (At(method, _FAST), f"{{recognizer: {{generations_per_frame: {n}}}}}"))
            for method in METHODS for n in (1, 3, 9)]),
        "refined": (few, Table(_REFINED, omegas=(*paper, 4 * _FAST))),
        "refined_latency": (few, [
            Variant(f"{n} frames, {how}", how, float(n), (_MFF, _REFINED, _Late(n, known)))
            for how, known in (("reckoned with", "null"), ("ignored", "0.0")) for n in (0, 3, 6)]),
        "velocity": (few, Table("{predictor: {mode: velocity}}", methods=["mff"], omegas=paper)),
        "latency": (few, [
            Variant(f"latency {n}, {how}", how, n, (_MFF, _Late(n, known)))
            for n in range(7) for how, known in latencies]),
        "gain": (few, [
            Variant(f"gain {g:g}", "mff", g, (_MFF, f"{{predictor: {{gain: {g}}}}}"))
            for g in (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)]),
        "hand_eye": (few, [
            Variant(f"{n} deg about {axis}", axis, n, (_MFF, _Turned(n, axis)))
            for axis in "xyz" for n in range(6)]),
        "noise": (few, [
            Variant(f"noise {n:g} deg", "mff", n, (_MFF, f"{{encoders: {{noise_deg: {n}}}}}"))
            for n in (0.0, 0.005, 0.01, 0.02, 0.05, 0.1)]),
        "faster": (few, Table(omegas=(2 * _FAST, 4 * _FAST))),
    }  # fmt: skip
    texts = ReadYaml(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    chosen = {name: study for name, study in studies.items() if not short or name in _SHORT}
    return tuple(
        Study(name, variants=_Chosen(name, variants, short), seeds=count, **texts[name])
        for name, (count, variants) in chosen.items() if count
    )  # fmt: skip


# What remains of the studies in short ones: the variants of these curves with these values.
_SHORT: dict[str, tuple[Sequence[str], Sequence[float]]] = {
    "near": (METHODS, PAPER_OMEGAS), "random": (METHODS, PAPER_OMEGAS), "fixed": (["fixed"], [0]),
    "plain": (METHODS, PAPER_OMEGAS), "gray": (METHODS, [_FAST]), "noise": (["mff"], [0.05]),
    "refined": (["mff"], PAPER_OMEGAS), "latency": (["known", "ignored"], [3]),
    "gain": (["mff"], [0.5]), "hand_eye": ("xyz", [5]),
}  # fmt: skip


def _Chosen(name: str, all_: Sequence[Variant], short: bool) -> tuple[Variant, ...]:
    curves, values = _SHORT.get(name, ((), ()))
    return tuple(v for v in all_ if not short or (v.curve in curves and v.value in values))


def _Late(frames: int, known: str) -> str:
    return f"{{camera: {{latency: {frames * _FRAME:.3f}}}, predictor: {{latency: {known}}}}}"


def _Turned(degrees: float, axis: str) -> str:
    error = [float(degrees * (axis == name)) for name in "xyz"]
    return f"{{predictor: {{hand_eye_error_deg: {error}}}}}"
