"""The cameras of a scenario: where they are on the hand, what they are, and what is known of them.

Frames: W world, E the hand, C the first camera, K any camera.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.sensors import CameraInfo

from mffdrake.experiment.scenario.camera_sections import HandCameraConfig
from mffdrake.experiment.scenario.scenario import Scenario, ScenarioError
from mffdrake.recognition import Camera, CameraRig
from mffdrake.systems.cameras.camera_frames import AddCameraFrame
from mffdrake.systems.cameras.camera_info import CameraFromInfo

__all__ = [
    "AddFrames",
    "CalcKnownX_EC",
    "KnownLatency",
    "MakeKnownRig",
    "MakeMounts",
    "MakeRig",
    "Mount",
]


@dc.dataclass(frozen=True, kw_only=True)
class Mount:
    """A camera and its place.

    Attributes:
        camera: The camera, with its place in the first one's frame C, which is the rig's.
        X_EK: Its pose on the hand.
        latency: Age of its images when they arrive [s].
    """

    camera: Camera
    X_EK: RigidTransform
    latency: float

    @property
    def frame_name(self) -> str:
        """Name of its frame in the plant."""
        return f"camera_{self.camera.name}"


def MakeMounts(scenario: Scenario) -> tuple[Mount, ...]:
    """The scenario's cameras, the first one the reference of all poses.

    Args:
        scenario: Its ``cameras`` count or, where there are none, its ``camera``.

    Raises:
        ScenarioError: When a camera is not on the hand's body, or its principal point is outside
            its image.

    Example:
        >>> [mount.frame_name for mount in MakeMounts(Scenario())]
        ['camera_right', 'camera_left']
    """
    if scenario.cameras is None:
        pair = scenario.camera
        rig = CameraRig.stereo(
            width=pair.width,
            height=pair.height,
            fov_y=math.radians(pair.fov_y_deg),
            baseline=pair.baseline,
        )
        X_EC = RigidTransform(pair.p_EC)
        return tuple(
            Mount(camera=camera, X_EK=X_EC @ RigidTransform(camera.p_CK), latency=pair.latency)
            for camera in rig.cameras
        )
    places = _CalcPlaces(scenario, scenario.cameras)
    mounts = []
    for config, X_EK in zip(scenario.cameras, places, strict=True):
        fx, fy = config.focal.CalcFocalLengths(config.width, config.height)
        X_CK = places[0].InvertAndCompose(X_EK)
        center_x = 0.5 * config.width if config.center_x is None else config.center_x
        center_y = 0.5 * config.height if config.center_y is None else config.center_y
        try:
            info = CameraInfo(config.width, config.height, fx, fy, center_x, center_y)
        except RuntimeError as error:
            raise ScenarioError(
                f"camera '{config.name}': center_x and center_y must be inside the image of "
                f"{config.width} x {config.height} px, not {center_x:g} and {center_y:g}"
            ) from error
        pinhole = CameraFromInfo(info, name=config.name, X_CK=X_CK)
        camera = dc.replace(pinhole, distortion=config.distortion.Make())
        mounts.append(Mount(camera=camera, X_EK=X_EK, latency=config.latency))
    return tuple(mounts)


def _CalcPlaces(scenario: Scenario, cameras: Sequence[HandCameraConfig]) -> list[RigidTransform]:
    """X_EK of every camera."""
    arm = scenario.arm
    frames = {config.X_PB.base_frame or arm.hand_frame for config in cameras}
    X_EP = {arm.hand_frame: RigidTransform()}
    if frames != {arm.hand_frame}:
        plant = arm.MakePlant()
        plant.Finalize()
        instance, context = plant.GetModelInstanceByName(arm.model), plant.CreateDefaultContext()
        hand = plant.GetFrameByName(arm.hand_frame, instance)
        for k, config in enumerate(cameras):
            name = config.X_PB.base_frame or arm.hand_frame
            known = plant.HasFrameNamed(name, instance)
            frame = plant.GetFrameByName(name, instance) if known else None
            if frame is None or frame.body().index() != hand.body().index():
                raise ScenarioError(
                    f"cameras[{k}].X_PB.base_frame must be a frame of {arm.model}'s body "
                    f"'{hand.body().name()}', such as '{arm.hand_frame}', not '{name}'"
                )
            X_EP[name] = frame.CalcPose(context, hand)
    return [
        X_EP[config.X_PB.base_frame or arm.hand_frame] @ config.X_PB.GetDeterministicValue()
        for config in cameras
    ]


def MakeRig(scenario: Scenario) -> CameraRig:
    """The cameras as they are.

    Returns:
        The rig, whose frame is the first camera's.
    """
    return CameraRig(tuple(mount.camera for mount in MakeMounts(scenario)))


def MakeKnownRig(scenario: Scenario) -> CameraRig:
    """The cameras as the recognizer knows them.

    Example:
        >>> from mffdrake.experiment.scenario.scenario import LoadScenario
        >>> scenario = LoadScenario(text="calibration: {baseline_error: 0.01}")
        >>> MakeKnownRig(scenario).cameras[1].p_CK
        array([-0.16,  0.  ,  0.  ])
    """
    error, rig = scenario.calibration, MakeRig(scenario)
    scale = 1.0 + error.focal_error
    cameras = []
    for camera in rig.cameras:
        distance = float(np.linalg.norm(camera.p_CK))
        stretch = 1.0 + error.baseline_error / distance if distance > 0.0 else 1.0
        cameras.append(
            dc.replace(
                camera, fx=scale * camera.fx, fy=scale * camera.fy, p_CK=stretch * camera.p_CK
            )
        )
    return CameraRig(tuple(cameras))


def CalcKnownX_EC(scenario: Scenario) -> RigidTransform:
    """The first camera's pose on the hand as the motion feedforward knows it.

    Returns:
        The pose X_EC (translation in m).
    """
    turn = RollPitchYaw(np.radians(scenario.predictor.hand_eye_error_deg)).ToRotationMatrix()
    X_error = RigidTransform(turn, scenario.predictor.hand_eye_error)
    return MakeMounts(scenario)[0].X_EK @ X_error


def AddFrames(plant: MultibodyPlant, arm: ModelInstanceIndex, scenario: Scenario) -> None:
    """Adds all cameras' frames to the hand, ``camera_...``.

    Args:
        plant: The plant with the arm, not finalized.
        arm: The arm.
        scenario: The scenario.
    """
    hand = plant.GetFrameByName(scenario.arm.hand_frame, arm)
    for mount in MakeMounts(scenario):
        AddCameraFrame(plant, name=mount.frame_name, parent=hand, X_PC=mount.X_EK)


def KnownLatency(scenario: Scenario) -> float:
    """The age of the images, as feedforward and servo reckon with it [s]."""
    known = scenario.predictor.latency
    return MakeMounts(scenario)[0].latency if known is None else known
