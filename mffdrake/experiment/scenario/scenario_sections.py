"""The sections of a scenario that are no classes of their own elsewhere."""

from __future__ import annotations

import dataclasses as dc
import math
from functools import cached_property
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
from annotated_types import Ge, Le, Lt
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from mffdrake.recognition.parameters import (
    Finite,
    Latency,
    Length,
    NonNegative,
    OneOf,
    Position,
    Text,
    Vector3,
    parameters,
)
from mffdrake.recognition.parameters.rotations import RpyDeg
from mffdrake.systems.arms.hand_path import HandPath
from mffdrake.systems.control.pd_gains import Gains, LightlyDamped
from mffdrake.systems.control.visual_servo import ServoParameters
from mffdrake.systems.target_motion import AtRest, Sinusoids, Step, Straight, Waypoints
from mffdrake.systems.target_motion.trajectory_file import TrajectoryFile
from mffdrake.systems.transforms import Pose
from mffdrake.systems.vision.target_motion_estimator import EstimatorParameters

__all__ = [
    "ControllerConfig",
    "EncodersConfig",
    "HandPathConfig",
    "NoServo",
    "PredictorConfig",
    "Servo",
    "ServoConfig",
    "TargetConfig",
]

Motion: TypeAlias = Annotated[
    AtRest | Sinusoids | Straight | Step | Waypoints | TrajectoryFile, OneOf()
]
"""A parameter that is one kind of motion; in YAML a tag or a name such as ``at_rest``."""


def _LikeFirstHandPose(x: float) -> Pose:
    """A pose with the axes of the paper's first hand pose: z forward, x right, y down."""
    return Pose(translation=(x, 0.0, 0.455), rotation=RpyDeg(deg=(-90.0, 0.0, -90.0)))


@parameters
class HandPathConfig:
    """The hand's desired path, Eq. (29)-(31).

    Attributes:
        amplitude_deg: Largest angle of the swing [deg].
        distance: Radius of the circle on which the hand moves [m].
        omega: Angular frequency of the swing [rad/s].
        X_WE0: The hand's first pose, Eq. (29).
    """

    amplitude_deg: Annotated[Finite, Ge(0), Lt(180)] = 15.0
    distance: Length = 0.8
    omega: Annotated[Finite, Ge(0), Le(1e3)] = 0.105
    X_WE0: Pose = dc.field(default_factory=lambda: _LikeFirstHandPose(0.918))

    def Make(self) -> HandPath:
        """The path."""
        return HandPath(
            amplitude=math.radians(self.amplitude_deg),
            distance=self.distance,
            omega=self.omega,
            X_WE0=self.X_WE0.GetDeterministicValue(),
        )


@parameters
class ControllerConfig:
    """The PD controller.

    Attributes:
        gains: A preset, "lightly_damped" (the paper's Fig. 6) or "well_damped", or
            ``!NaturalFrequency {frequency_hz: 1, damping_ratio: 1}``, from the mass matrix.
        kp: Proportional gains [N m/rad], one a joint; they replace those.
        kd: Derivative gains [N m s/rad], likewise.
        gravity_compensation: Whether the arm's weight is compensated.
        computed_torque: Whether the torques of the desired accelerations are added, the weight's
            included; without, the hand lags where it accelerates.
    """

    gains: Gains = dc.field(default_factory=LightlyDamped)
    kp: tuple[NonNegative, ...] | None = None
    kd: tuple[NonNegative, ...] | None = None
    gravity_compensation: bool = True
    computed_torque: bool = False


@parameters
class EncodersConfig:
    """The joint encoders, which the controller and the motion feedforward read.

    Attributes:
        noise_deg: Standard deviation of a joint angle's error, another one every tick [deg].
        offset_deg: Constant error of each joint angle, one number a joint [deg]; empty for none.
        resolution_deg: Step of the joint angles that can be read [deg]; 0 for no rounding.
    """

    noise_deg: Annotated[Finite, Ge(0), Le(360)] = 0.0
    offset_deg: tuple[Annotated[Finite, Ge(-360), Le(360)], ...] = ()
    resolution_deg: Annotated[Finite, Ge(0), Le(360)] = 0.0


@parameters
class TargetConfig:
    """The known object.

    Attributes:
        model: URL or path of its SDF or URDF, whose visuals are together a closed, colored surface.
            A relative path is looked for beside the scenario file, then from the current folder.
        X_WM: Its pose in the world, from which it moves.
        motion: How it moves: at_rest, ``!Sinusoids {...}``, ``!Straight {...}``, ``!Step {...}``,
            ``!Waypoints {...}`` or ``!TrajectoryFile {file: poses.tum}``.
    """

    model: Text = "package://mffdrake/target_box.sdf"
    X_WM: Pose = dc.field(default_factory=lambda: _LikeFirstHandPose(1.718))
    motion: Motion = dc.field(default_factory=AtRest)

    def CalcPose(self, time: float) -> RigidTransform:
        """The target's pose X_WM at a time [s]."""
        return self.motion.CalcPose(self._X_WM0, time)

    def CalcVelocity(self, time: float) -> NDArray[np.float64]:
        """Its velocity (v_WM, w_WM) [m/s, rad/s] at a time [s], shape (6,)."""
        return self.motion.CalcVelocity(self._X_WM0, time)

    @cached_property
    def _X_WM0(self) -> RigidTransform:
        return self.X_WM.GetDeterministicValue()


@parameters
class NoServo:
    """The hand follows its path, whatever the target does."""

    kind: ClassVar[str] = "none"


@parameters
class ServoConfig:
    """The hand follows the target by what it sees: it keeps it where it is at the start.

    At rest at its ``X_WM``, the target is where the camera wants it when the hand is at the path's
    first pose.

    Attributes:
        controller: How the hand follows.
        estimator: How the target's motion is estimated.
        feed_velocity: Whether the target's velocity goes to the motion feedforward, too.
        source: What tells where the target is: "camera", or "truth", the limit of what any
            recognizer can do.
    """

    kind: ClassVar[str] = "follow"

    controller: ServoParameters = dc.field(default_factory=ServoParameters)
    estimator: EstimatorParameters = dc.field(default_factory=EstimatorParameters)
    feed_velocity: bool = True
    source: Literal["camera", "truth"] = "camera"


@parameters
class PredictorConfig:
    """The motion feedforward; see `MffPredictor`.

    Attributes:
        mode: "rigid" (exact) or "velocity" (Eq. 12).
        latency: The age of the images that it reckons with [s]; null for the cameras' own.
        gain: Share of the predicted motion that is applied.
        hand_eye_error_deg: Roll, pitch and yaw by which the cameras' orientation on the hand, as it
            is known, differs from the true one [deg].
        hand_eye_error: The same of their position, along the first camera's axes [m].
    """

    mode: Literal["rigid", "velocity"] = "rigid"
    latency: Latency | None = None
    gain: Finite = 1.0
    hand_eye_error_deg: Vector3 = (0.0, 0.0, 0.0)
    hand_eye_error: Position = (0.0, 0.0, 0.0)


Servo: TypeAlias = Annotated[NoServo | ServoConfig, OneOf()]
"""A parameter that says whether the hand follows the target: ``none`` or ``!Follow {...}``."""
