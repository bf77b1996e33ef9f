"""Scenarios: everything a simulation depends on, as frozen dataclasses that are read from YAML."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import MinLen

from mffdrake.experiment.scenario.camera_sections import (
    CalibrationConfig,
    HandCameraConfig,
    StereoCameraConfig,
)
from mffdrake.experiment.scenario.own_files import FindOwnFiles
from mffdrake.experiment.scenario.scenario_sections import (
    ControllerConfig,
    EncodersConfig,
    HandPathConfig,
    NoServo,
    PredictorConfig,
    Servo,
    ServoConfig,
    TargetConfig,
)
from mffdrake.recognition import TrackerParameters
from mffdrake.recognition.parameters import (
    Duration,
    ParameterError,
    Seed,
    merge,
    parameters,
    plain,
    read_parameters,
    shown,
)
from mffdrake.recognition.parameters.yaml_text import DumpYaml, ReadYaml
from mffdrake.systems.arms.arm import ArmModel
from mffdrake.systems.clutter import Clutter
from mffdrake.systems.disturbances import Disturbance
from mffdrake.systems.timing import Timing

__all__ = ["METHODS", "Change", "LoadScenario", "Scenario", "ScenarioError", "ServoDefaults"]


class ScenarioError(ParameterError):
    """A scenario is wrong; the message is one line for the person who wrote it.

    Example:
        >>> try:
        ...     LoadScenario(text="duration: -1")
        ... except ScenarioError as error:
        ...     print(error)
        scenario text: duration must be positive, not -1
    """


_NEAREST = 0.001  # m, of the searched depths

METHODS = ("ga", "mff")
"""The methods: without motion feedforward (the plain 1-step GA), and with it."""


@parameters
class Scenario:
    """Everything a simulation depends on. The defaults are the paper's experiment.

    Attributes:
        hand_path: The hand's desired path.
        controller: The PD controller.
        arm: The arm.
        camera: The stereo camera.
        cameras: Any cameras in the stereo camera's place, the first one the reference; null for
            the stereo camera.
        calibration: Errors of the cameras as the recognizer knows them.
        disturbances: What disturbs the images, the first one nearest to the cameras.
        clutter: What moves in the scene beside the target.
        encoders: The joint encoders.
        target: The object to recognize.
        servo: Whether the hand follows the target by what it sees: none, or ``!Follow {...}``; then
            only its path's first pose counts.
        recognizer: The recognizer.
        predictor: The motion feedforward.
        timing: Control and vision periods.
        method: "mff": with motion feedforward; "ga": without, the plain 1-step GA.
        renderer: What draws the images: "vtk" or "flat", see `AddRenderer`.
        duration: Simulated time [s].
        seed: Of the random numbers.

    Raises:
        ParameterError: When a value is wrong; one line with the key and what is allowed.

    Example:
        >>> scenario = LoadScenario(text="hand_path: {omega: 0.314}")
        >>> scenario.hand_path.omega, scenario.method
        (0.314, 'mff')
    """

    hand_path: HandPathConfig = dc.field(default_factory=HandPathConfig)
    controller: ControllerConfig = dc.field(default_factory=ControllerConfig)
    arm: ArmModel = dc.field(default_factory=ArmModel)
    camera: StereoCameraConfig = dc.field(default_factory=StereoCameraConfig)
    cameras: Annotated[tuple[HandCameraConfig, ...], MinLen(1)] | None = None
    calibration: CalibrationConfig = dc.field(default_factory=CalibrationConfig)
    disturbances: tuple[Disturbance, ...] = ()
    clutter: tuple[Clutter, ...] = ()
    encoders: EncodersConfig = dc.field(default_factory=EncodersConfig)
    target: TargetConfig = dc.field(default_factory=TargetConfig)
    servo: Servo = dc.field(default_factory=NoServo)
    recognizer: TrackerParameters = dc.field(default_factory=TrackerParameters)
    predictor: PredictorConfig = dc.field(default_factory=PredictorConfig)
    timing: Timing = dc.field(default_factory=Timing)
    method: Literal["ga", "mff"] = "mff"
    renderer: Literal["vtk", "flat"] = "vtk"
    duration: Duration = 40.0
    seed: Seed = 0

    def __post_init__(self) -> None:
        """Checks what concerns several sections."""
        tick = self.timing.control_period
        if self.timing.IsShort(self.duration):
            raise ValueError(
                f"duration must be at least timing.control_period ({tick} s), not {self.duration}"
            )
        if isinstance(self.servo, ServoConfig) and self.timing.IsShort(
            self.servo.controller.period
        ):
            raise ValueError(
                f"servo.controller.period must be at least timing.control_period ({tick} s), not "
                f"{self.servo.controller.period}"
            )
        cameras = self.cameras or ()
        names = [camera.name for camera in cameras]
        if len(set(names)) < len(names):
            raise ValueError(f"cameras must have different names, not {', '.join(names)}")
        for section, latency in (
            ("camera", self.camera.latency),
            *((f"cameras[{k}]", camera.latency) for k, camera in enumerate(cameras)),
            ("predictor", self.predictor.latency or 0.0),
        ):
            try:
                self.timing.CheckLatency(latency)
            except ValueError as error:
                raise ValueError(f"{section}.{error}") from error
        z = self.recognizer.search_range.z
        if z[0] < _NEAREST:
            raise ValueError(
                "recognizer.search_range.z must lie in front of the camera (at least "
                f"{_NEAREST} m), not {list(z)}"
            )

    @cached_property
    def fingerprint(self) -> str:
        """The same for equal scenarios, and for no others."""
        data = json.dumps(plain(self), sort_keys=True)
        return hashlib.sha256(data.encode()).hexdigest()

    def Dump(self) -> str:
        """The scenario as YAML, complete, which `LoadScenario` reads back to the last bit."""
        return DumpYaml(plain(self))


def LoadScenario(
    file: Path | str | None = None, text: str | None = None, *, defaults: Scenario | None = None
) -> Scenario:
    """Reads a scenario: the defaults, then a file on top, then a text on top.

    Args:
        file: A YAML file. Models and trajectories that it names by a relative path are looked for
            beside it, then from the current folder.
        text: YAML. Relative paths in it lead from the current folder.
        defaults: The defaults; `Scenario`'s own without.

    Returns:
        The scenario.

    Raises:
        ScenarioError: When a key is unknown or a value has the wrong type or range; the message
            names the file, the key and what is allowed.
        OSError: When the file cannot be read.

    Example:
        >>> LoadScenario(text="{seed: 3, camera: {width: 320, height: 240}}").camera.width
        320
    """
    scenario = Scenario() if defaults is None else defaults
    sources: list[tuple[str, str, Path | None]] = []
    if file is not None:
        try:
            sources.append((str(file), Path(file).read_text(encoding="utf-8"), Path(file).parent))
        except UnicodeDecodeError as error:
            raise ScenarioError(f"{file}: not a text file in UTF-8") from error
    if text is not None:
        sources.append(("scenario text", text, None))
    for name, yaml_text, folder in sources:
        try:
            data = ReadYaml(yaml_text)
            if folder is not None:
                data = FindOwnFiles(data, folder)
            scenario = read_parameters(Scenario, merge(scenario, data))
        except ParameterError as error:
            raise ScenarioError(f"{name}: {error}") from error
    return scenario


def Change(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """A scenario with other values.

    Args:
        scenario: The scenario, which stays as it is.
        values: Dotted keys and plain data, as YAML has it.

    Returns:
        The other scenario.

    Raises:
        ScenarioError: When a key is unknown or part of another one, or a value has the wrong type
            or range.

    Example:
        >>> Change(Scenario(), {"seed": 3, "camera.width": 320}).camera.width
        320
    """
    nested: dict[str, Any] = {}
    for key, value in values.items():
        for other in values:
            if str(other).startswith(f"{key}."):
                raise ScenarioError(f"{shown(key)} and {shown(other)} overlap; change one of them")
        *sections, name = str(key).split(".")
        inner = nested
        for section in sections:
            inner = inner.setdefault(section, {})
        inner[name] = value
    try:
        return read_parameters(Scenario, merge(scenario, nested))
    except ParameterError as error:
        raise ScenarioError(str(error)) from error


def ServoDefaults() -> Scenario:
    """What ``servo`` starts from: `Scenario`'s defaults, with an arm and a servo that are fast."""
    return Change(
        Scenario(),
        {
            "controller": {"gains": "well_damped", "computed_torque": True},
            "recognizer": {"refinement": "borders"},
            "servo": {"_tag": "!Follow", "controller": {"gain": 8.0}},
            "target.motion": "sinusoids",
            "duration": 20.0,
        },
    )
