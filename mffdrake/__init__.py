"""Pose recognition by a moving stereo camera, with motion feedforward, as Drake systems.

The public names of the three rooms: `mffdrake.recognition` (no simulator), `mffdrake.systems` (Drake
systems) and `mffdrake.experiment` (scenarios, simulations, results). They load when first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mffdrake.experiment.comparison import Compare, MakeVariants
    from mffdrake.experiment.diagram import MakeHandEyeDiagram
    from mffdrake.experiment.evaluation import Evaluate, MarkdownTable
    from mffdrake.experiment.scenario import LoadScenario, Scenario, ScenarioError
    from mffdrake.experiment.simulation import Simulate, SimulationResult
    from mffdrake.recognition import (
        GeneCoding,
        GeneticParameters,
        LocalMoveParameters,
        Matcher,
        MatchingParameters,
        NearStart,
        OneStepGaTracker,
        RandomStart,
        SamplingParameters,
        SearchModel,
        SearchRange,
        SolidModel,
        StereoCamera,
    )
    from mffdrake.systems.graphics import GraphicsUnavailableError, RequireGraphics
    from mffdrake.systems.hand_path import (
        AddHandPathSource,
        HandPath,
        SolveHandPath,
        UnreachablePathError,
    )
    from mffdrake.systems.models import ConfigureParser, FindModelsPath
    from mffdrake.systems.pa10 import AddCameraFrames, AddPa10, MakePa10Plant
    from mffdrake.systems.pd_controller import (
        PD_GAINS,
        AddGravityCompensation,
        PdController,
        PdGains,
    )
    from mffdrake.systems.predictor import MffPredictor
    from mffdrake.systems.recognizer import OneStepGaRecognizer
    from mffdrake.systems.renderers import AddRenderer
    from mffdrake.systems.stereo_camera import AddStereoCamera
    from mffdrake.systems.timing import Timing

_MODULES = {
    "experiment.comparison": "Compare MakeVariants",
    "experiment.diagram": "MakeHandEyeDiagram",
    "experiment.evaluation": "Evaluate MarkdownTable",
    "experiment.scenario": "LoadScenario Scenario ScenarioError",
    "experiment.simulation": "Simulate SimulationResult",
    "recognition": (
        "GeneCoding GeneticParameters LocalMoveParameters Matcher MatchingParameters NearStart "
        "OneStepGaTracker RandomStart SamplingParameters SearchModel SearchRange SolidModel "
        "StereoCamera"
    ),
    "systems.graphics": "GraphicsUnavailableError RequireGraphics",
    "systems.hand_path": "AddHandPathSource HandPath SolveHandPath UnreachablePathError",
    "systems.models": "ConfigureParser FindModelsPath",
    "systems.pa10": "AddCameraFrames AddPa10 MakePa10Plant",
    "systems.pd_controller": "PD_GAINS AddGravityCompensation PdController PdGains",
    "systems.predictor": "MffPredictor",
    "systems.recognizer": "OneStepGaRecognizer",
    "systems.renderers": "AddRenderer",
    "systems.stereo_camera": "AddStereoCamera",
    "systems.timing": "Timing",
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    """Loads a public name's module when the name is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'mffdrake' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"mffdrake.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *__all__]
