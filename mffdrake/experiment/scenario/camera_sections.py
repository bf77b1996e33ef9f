"""The sections of a scenario on cameras: the paper's stereo pair, or any cameras on the hand."""

from __future__ import annotations

import dataclasses as dc
import math
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le, MinLen

from mffdrake.recognition import Distortion
from mffdrake.recognition.parameters import (
    Coordinate,
    Finite,
    Latency,
    Length,
    OneOf,
    Pixels,
    Position,
    Positive,
    Text,
    parameters,
    shown,
)
from mffdrake.systems.cameras.camera_frames import DEFAULT_BASELINE, DEFAULT_P_EC
from mffdrake.systems.transforms import Pose

__all__ = ["CalibrationConfig", "HandCameraConfig", "StereoCameraConfig"]

_Angle = Annotated[Finite, Ge(0.001), Le(179.9)]


_Focal = Annotated[Finite, Ge(1e-3), Le(1e6)]
_MOST_PIXELS = 2**26  # of an image


def _CheckSize(width: int, height: int) -> None:
    if width * height > _MOST_PIXELS:
        raise ValueError(
            f"width and height must make an image of at most {_MOST_PIXELS} pixels, not of "
            f"{width * height}"
        )


@parameters
class StereoCameraConfig:
    """The paper's stereo camera on the hand: the cameras "right" and "left".

    Attributes:
        width: Image width [px].
        height: Image height [px].
        fov_y_deg: Vertical field of view [deg].
        baseline: Distance between the cameras [m].
        p_EC: The right camera's position in the hand's frame [m].
        latency: Age of the images when they arrive [s], a whole multiple of the control period.
    """

    width: Pixels = 640
    height: Pixels = 480
    fov_y_deg: _Angle = 45.0
    baseline: Length = DEFAULT_BASELINE
    p_EC: Position = DEFAULT_P_EC
    latency: Latency = 0.0

    def __post_init__(self) -> None:
        """Checks the size of the images."""
        _CheckSize(self.width, self.height)


@parameters
class FovDegrees:
    """Focal length by the field of view.

    Attributes:
        y: Vertical field of view [deg].
        x: Horizontal field of view [deg]; null for square pixels.
    """

    y: _Angle = 45.0
    x: _Angle | None = None

    def CalcFocalLengths(self, width: int, height: int) -> tuple[float, float]:
        """Along u and v [px]."""
        fy = 0.5 * height / math.tan(0.5 * math.radians(self.y))
        return fy if self.x is None else 0.5 * width / math.tan(0.5 * math.radians(self.x)), fy


@parameters
class FocalLength:
    """Focal length in pixels.

    Attributes:
        x: Along u [px].
        y: Along v [px]; null for the same.
    """

    x: _Focal
    y: _Focal | None = None

    def CalcFocalLengths(self, width: int, height: int) -> tuple[float, float]:
        """Along u and v [px]."""
        return self.x, self.x if self.y is None else self.y


@parameters
class NoDistortion:
    """A pinhole."""

    kind: ClassVar[str] = "none"

    def Make(self) -> Distortion:
        """The lens."""
        return Distortion()


@parameters
class PlumbBob:
    """OpenCV's and ROS's polynomial model.

    Attributes:
        coefficients: k1, k2, p1, p2 and, of five, k3 and, of eight, k4, k5, k6.
    """

    coefficients: tuple[Finite, ...]

    def __post_init__(self) -> None:
        """Checks the number of coefficients."""
        self.Make()

    def Make(self) -> Distortion:
        """The lens."""
        return Distortion("plumb_bob", self.coefficients)


@parameters
class Equidistant:
    """OpenCV's fisheye.

    Attributes:
        coefficients: k1 to k4.
    """

    coefficients: tuple[Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0)

    def Make(self) -> Distortion:
        """The lens."""
        return Distortion("equidistant", self.coefficients)


@parameters
class CameraPose(Pose):
    """Pose of a camera: x right, y down, z along the line of sight.

    Attributes:
        base_frame: Name of the arm's frame that the pose is told in and that carries the camera;
            null for the hand's. All cameras must be on the hand's body.
    """

    base_frame: Text | None = None


@parameters
class HandCameraConfig:
    """One camera on the hand, with the keys of Drake's CameraConfig where that has them.

    Attributes:
        name: What it is called.
        width: Image width [px].
        height: Image height [px].
        focal: ``!FovDegrees {y: 45}`` or ``!FocalLength {x: 580}``.
        center_x: Principal point's u as Drake has it, where the image spans 0 to ``width`` [px];
            null for the middle.
        center_y: Principal point's v [px]; null for the middle.
        X_PB: Its pose on the hand.
        distortion: "none", ``!PlumbBob {coefficients: [...]}`` or ``!Equidistant {...}``.
        latency: Age of its images when they arrive [s], a whole multiple of the control period.
    """

    name: Annotated[Text, MinLen(1)]
    width: Pixels = 640
    height: Pixels = 480
    focal: Annotated[FovDegrees | FocalLength, OneOf()] = dc.field(default_factory=FovDegrees)
    center_x: Positive | None = None
    center_y: Positive | None = None
    X_PB: CameraPose = dc.field(default_factory=CameraPose)
    distortion: Annotated[NoDistortion | PlumbBob | Equidistant, OneOf()] = dc.field(
        default_factory=NoDistortion
    )
    latency: Latency = 0.0

    def __post_init__(self) -> None:
        """Checks the name, which recordings have a folder of, and the size of the images."""
        if self.name.startswith("/") or {".", ".."} & set(self.name.split("/")):
            raise ValueError(
                f"name must be that of a folder, too, not {shown(self.name)}: without . and .. "
                "and / at its beginning"
            )
        _CheckSize(self.width, self.height)


@parameters
class CalibrationConfig:
    """What the recognizer takes for true of the cameras, and is not quite.

    Attributes:
        focal_error: The focal lengths' relative error: 0.01 for 1 % too long.
        baseline_error: So much farther from the first camera are the others [m].
    """

    focal_error: Annotated[Finite, Gt(-1), Ge(-0.999), Le(1e3)] = 0.0
    baseline_error: Coordinate = 0.0
