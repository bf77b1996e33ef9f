"""Makes the parts of the hand-eye system that a scenario describes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from mffdrake.experiment.scenario import Scenario, ScenarioError
from mffdrake.experiment.scenario_sections import RecognizerConfig
from mffdrake.recognition import (
    AdaptiveWhiteBalance,
    BorderRefiner,
    CameraRig,
    ColorModel,
    FixedWhiteBalance,
    Matcher,
    NearStart,
    NoRefinement,
    OneStepGaTracker,
    RandomStart,
    Refiner,
    SearchModel,
    SolidModel,
    Start,
)
from mffdrake.systems.graphics import GraphicsUnavailableError
from mffdrake.systems.joint_encoders import JointEncoders
from mffdrake.systems.pd_controller import PdController
from mffdrake.systems.pd_gains import PD_GAINS, PdGains
from mffdrake.systems.renderers import AddRenderer

__all__ = ["AddEncoders", "AddSceneRenderer", "MakeController", "MakeRig", "MakeTracker"]


def MakeTracker(
    config: RecognizerConfig,
    *,
    solid: SolidModel,
    rig: CameraRig,
    seed: int,
    start_pose: NDArray[np.float64],
    colors: ColorModel | None = None,
) -> OneStepGaTracker:
    """The tracker that a scenario's section describes.

    Args:
        config: The section.
        solid: The object to recognize.
        rig: The cameras.
        seed: Of the random numbers.
        start_pose: Where the first population lies for ``start: near_target``: the target's pose
            vector in the rig's frame, shape (6,).
        colors: How the solid's materials look; by default as its mesh has them.

    Returns:
        The tracker.

    Raises:
        ValueError: When the colors lack one of the solid's materials.
    """
    position_spread, quaternion_spread = config.start_spread
    starts: dict[str, Start] = {
        "random": RandomStart(),
        "near_target": NearStart(start_pose, (position_spread, quaternion_spread)),
    }
    model = SearchModel(solid, config.MakeSampling())
    matcher = Matcher(model, rig, config.MakeMatching(), colors)
    refiners: dict[str, Refiner] = {"none": NoRefinement(), "borders": BorderRefiner(matcher)}
    rate = config.white_balance_rate
    return OneStepGaTracker(
        matcher=matcher,
        coding=config.MakeCoding(),
        parameters=config.MakeParameters(),
        local_moves=config.MakeLocalMoves(),
        generations_per_frame=config.generations_per_frame,
        start=starts[config.start],
        refiner=refiners[config.refinement],
        white_balance=AdaptiveWhiteBalance(rate) if rate > 0.0 else FixedWhiteBalance(),
        seed=seed,
    )


def MakeRig(scenario: Scenario) -> CameraRig:
    """The geometry of the scenario's stereo camera."""
    config = scenario.camera
    return CameraRig.stereo(
        width=config.width,
        height=config.height,
        fov_y=np.radians(config.fov_y_deg),
        baseline=config.baseline,
    )


def AddEncoders(builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario) -> OutputPort:
    """The port with the arm's state as it is read; free of error, that is the plant's own."""
    if scenario.encoders.noise_deg == 0.0:
        return plant.get_state_output_port()
    encoders = builder.AddNamedSystem(
        "joint_encoders",
        JointEncoders(
            noise=math.radians(scenario.encoders.noise_deg),
            seed=scenario.seed,
            timing=scenario.timing.Make(),
        ),
    )
    builder.Connect(plant.get_state_output_port(), encoders.get_input_port())
    return encoders.get_output_port()


def AddSceneRenderer(scene_graph: SceneGraph, scenario: Scenario) -> str:
    """Adds the renderer, which is when the target's mesh is read for drawing."""
    try:
        return AddRenderer(scene_graph, scenario.renderer)
    except GraphicsUnavailableError:
        raise
    except (RuntimeError, ValueError, NotImplementedError) as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(
            f"target.model '{scenario.target.model}' cannot be drawn: {reason}"
        ) from error


def MakeController(scenario: Scenario, arm: MultibodyPlant) -> PdController:
    """The scenario's controller, with the effort limits of the arm's model."""
    config = scenario.controller
    preset: PdGains = PD_GAINS[config.gains]
    return PdController(
        kp=preset.kp if config.kp is None else config.kp,
        kd=preset.kd if config.kd is None else config.kd,
        effort_limit=arm.GetEffortUpperLimits(),
        timing=scenario.timing.Make(),
    )
