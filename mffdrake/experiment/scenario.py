"""Scenarios: everything a simulation depends on, as dataclasses that are read from YAML."""

# No `from __future__ import annotations`: Drake's YAML reader needs the fields' types themselves.

import copy
import dataclasses as dc
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydrake.common.yaml import yaml_dump, yaml_dump_typed, yaml_load_data, yaml_load_typed

from mffdrake.experiment.scenario_check import CheckKeysAndTypes, ReadYaml, ScenarioError
from mffdrake.experiment.scenario_sections import (
    CameraConfig,
    ControllerConfig,
    EncodersConfig,
    HandPathConfig,
    PredictorConfig,
    RecognizerConfig,
    TargetConfig,
    TimingConfig,
)
from mffdrake.systems.pd_gains import PD_GAINS
from mffdrake.systems.renderers import RENDERERS

__all__ = ["METHODS", "LoadRecognizer", "LoadScenario", "Scenario", "ScenarioError", "WithSeed"]

METHODS = ("ga", "mff")
"""The methods: the plain 1-step GA, and the same with motion feedforward."""


@dc.dataclass(kw_only=True, slots=True)
class Scenario:
    """Everything a simulation depends on. The defaults are the paper's experiment.

    Attributes:
        hand_path: The hand's desired path.
        controller: The PD controller.
        camera: The stereo camera.
        encoders: The joint encoders.
        target: The object to recognize.
        recognizer: The recognizer.
        predictor: The motion feedforward.
        timing: Control and vision periods.
        method: "ga": the plain 1-step GA; "mff": with motion feedforward.
        renderer: What draws the images: "vtk" or "flat", see `AddRenderer`.
        duration: Simulated time [s].
        seed: Of the random numbers, at least 0.

    Example:
        >>> scenario = LoadScenario(text="hand_path: {omega: 0.314}")
        >>> scenario.hand_path.omega, scenario.method
        (0.314, 'mff')
    """

    hand_path: HandPathConfig = dc.field(default_factory=HandPathConfig)
    controller: ControllerConfig = dc.field(default_factory=ControllerConfig)
    camera: CameraConfig = dc.field(default_factory=CameraConfig)
    encoders: EncodersConfig = dc.field(default_factory=EncodersConfig)
    target: TargetConfig = dc.field(default_factory=TargetConfig)
    recognizer: RecognizerConfig = dc.field(default_factory=RecognizerConfig)
    predictor: PredictorConfig = dc.field(default_factory=PredictorConfig)
    timing: TimingConfig = dc.field(default_factory=TimingConfig)
    method: str = "mff"
    renderer: str = "vtk"
    duration: float = 40.0
    seed: int = 0

    def Validate(self) -> None:
        """Checks every value that can be checked without building the diagram.

        Raises:
            ScenarioError: One line that names the key, the allowed values and the given one.
        """
        try:
            CheckKeysAndTypes(yaml_load_data(self.Dump(), private=True), Scenario)
        except (AttributeError, TypeError, RuntimeError) as error:
            raise ScenarioError(f"a value of the scenario has the wrong type: {error}") from error
        self.CheckRanges()

    def CheckRanges(self) -> None:
        """The part of `Validate` for a scenario whose values have the right types; much faster.

        Raises:
            ScenarioError: See `Validate`.

        Example:
            >>> Scenario(seed=3).CheckRanges()
        """
        _Choice("method", self.method, METHODS)
        _Choice("renderer", self.renderer, tuple(RENDERERS))
        _CheckRecognizer(self.recognizer)
        _Choice("predictor.mode", self.predictor.mode, ("rigid", "velocity"))
        _Choice("controller.gains", self.controller.gains, tuple(PD_GAINS))
        _Require(0 < self.duration < math.inf, "duration", self.duration, "must be positive")
        tick = self.timing.control_period
        _Require(
            self.duration >= tick,
            "duration",
            self.duration,
            f"must be at least timing.control_period ({tick} s)",
        )
        for key in ("camera.width", "camera.height", "camera.baseline"):
            section, _, name = key.partition(".")
            value = getattr(getattr(self, section), name)
            _Require(0 < value < math.inf, key, value, "must be positive")
        _Require(self.seed >= 0, "seed", self.seed, "must be at least 0")
        _Require(self.seed < 2**63, "seed", self.seed, "must be below 2^63")
        amplitude = self.hand_path.amplitude_deg
        _Require(
            0 <= amplitude < 180,
            "hand_path.amplitude_deg",
            amplitude,
            "must be from 0 to below 180",
        )
        distance, omega = self.hand_path.distance, self.hand_path.omega
        _Require(0 < distance < math.inf, "hand_path.distance", distance, "must be positive")
        _Require(0 <= omega < math.inf, "hand_path.omega", omega, "must be 0 or positive")
        fov = self.camera.fov_y_deg
        _Require(0 < fov < 180, "camera.fov_y_deg", fov, "must be between 0 and 180")
        _Length("camera.p_EC", self.camera.p_EC, 3)
        for name in ("kp", "kd"):
            gains = getattr(self.controller, name)
            if gains is not None:
                _Length(f"controller.{name}", gains, 7)
                _Require(min(gains) >= 0, f"controller.{name}", gains, "must be at least 0")
        for section, make in (
            ("hand_path", self.hand_path.Make),
            ("timing", self.timing.Make),
        ):
            _CheckMaking(section, make)
        for section, latency in (
            ("camera", self.camera.latency),
            ("predictor", self.predictor.latency or 0.0),
        ):
            try:
                self.timing.Make().CheckLatency(latency)
            except ValueError as error:
                raise ScenarioError(f"{section}.{error}") from error
        noise = self.encoders.noise_deg
        _Require(0 <= noise < math.inf, "encoders.noise_deg", noise, "must be at least 0")
        z = self.recognizer.search_range.z
        _Require(
            z[0] > 0, "recognizer.search_range.z", z, "must lie in front of the camera (above 0 m)"
        )
        error_deg = self.predictor.hand_eye_error_deg
        _Length("predictor.hand_eye_error_deg", error_deg, 3)
        _Require(
            math.isfinite(self.predictor.gain),
            "predictor.gain",
            self.predictor.gain,
            "must be finite",
        )

    def Dump(self) -> str:
        """The scenario as YAML, complete, which `LoadScenario` reads back to the last bit."""
        data = yaml_load_data(yaml_dump_typed(self), private=True)
        _AddNulls(data, self)
        return yaml_dump(data)


def LoadScenario(
    file: Path | str | None = None, text: str | None = None, *, defaults: Scenario | None = None
) -> Scenario:
    """Reads a scenario: the defaults, then a file on top, then a text on top.

    Args:
        file: A YAML file.
        text: YAML.
        defaults: The defaults; `Scenario`'s own without. They stay as they are.

    Returns:
        The checked scenario.

    Raises:
        ScenarioError: When a key is unknown or a value has the wrong type or range; the message
            names the file, the key and what is allowed.
        OSError: When the file cannot be read.

    Example:
        >>> LoadScenario(text="{seed: 3, camera: {width: 320, height: 240}}").camera.width
        320
    """
    scenario = Scenario() if defaults is None else copy.deepcopy(defaults)
    sources = []
    if file is not None:
        try:
            sources.append((str(file), Path(file).read_text(encoding="utf-8")))
        except UnicodeDecodeError as error:
            raise ScenarioError(f"{file}: not a text file in UTF-8") from error
    if text is not None:
        sources.append(("scenario text", text))
    for name, yaml_text in sources:
        try:
            data = ReadYaml(yaml_text)
            CheckKeysAndTypes(data, Scenario)
            if data:
                scenario = yaml_load_typed(schema=Scenario, data=yaml_text, defaults=scenario)
            scenario.Validate()
        except ScenarioError as error:
            raise ScenarioError(f"{name}: {error}") from error
    return scenario


def LoadRecognizer(text: str) -> RecognizerConfig:
    """Reads a scenario's section ``recognizer`` by itself.

    Args:
        text: YAML with the section's keys.

    Returns:
        The checked section. Its search range may lie anywhere, as a rig's frame may.

    Raises:
        ScenarioError: When a key is unknown or a value has the wrong type or range.

    Example:
        >>> LoadRecognizer("{refinement: borders, search_range: {z: [-0.1, 0.2]}}").refinement
        'borders'
    """
    data = ReadYaml(text)
    CheckKeysAndTypes(data, RecognizerConfig, "recognizer")
    config = RecognizerConfig()
    if data:
        config = yaml_load_typed(schema=RecognizerConfig, data=text, defaults=config)
    _CheckRecognizer(config)
    return config


def WithSeed(dumped: str, seed: int) -> str:
    """A dumped scenario with another seed; reading and writing it takes some milliseconds.

    Args:
        dumped: What `Scenario.Dump` made.
        seed: The seed, at least 0.

    Returns:
        The same YAML but for the seed.

    Example:
        >>> LoadScenario(text=WithSeed(Scenario().Dump(), 7)).seed
        7
    """
    # The line is there once: what is nested is indented.
    return re.sub(r"(?m)^seed: \d+$", f"seed: {seed}", dumped)


def _AddNulls(data: dict[str, Any], config: object) -> None:
    """Adds the keys without a value, which would read as defaults: Drake's writer omits them."""
    for field in dc.fields(config):  # type: ignore[arg-type]
        value = getattr(config, field.name)
        if value is None:
            data[field.name] = None
        elif dc.is_dataclass(value):
            _AddNulls(data[field.name], value)


def _CheckRecognizer(config: RecognizerConfig) -> None:
    """Checks the ranges of the section ``recognizer``."""
    _Choice("recognizer.start", config.start, ("random", "near_target"))
    _Choice("recognizer.refinement", config.refinement, ("none", "borders"))
    _Choice("recognizer.coding", config.coding, ("binary", "gray"))
    spread = config.start_spread
    _Length("recognizer.start_spread", spread, 2)
    _Require(min(spread) >= 0, "recognizer.start_spread", spread, "must be at least 0")
    generations = config.generations_per_frame
    _Require(
        generations >= 1, "recognizer.generations_per_frame", generations, "must be at least 1"
    )
    rate = config.white_balance_rate
    _Require(0 <= rate < math.inf, "recognizer.white_balance_rate", rate, "must be at least 0")
    for section, make in (
        ("recognizer", config.MakeCoding),
        ("recognizer", config.MakeParameters),
        ("recognizer.sampling", config.MakeSampling),
        ("recognizer.matching", config.MakeMatching),
        ("recognizer.local_moves", config.MakeLocalMoves),
    ):
        _CheckMaking(section, make)


def _CheckMaking(section: str, make: Callable[[], object]) -> None:
    """Makes what a section describes, which checks ranges of its own."""
    try:
        make()
    except ValueError as error:
        message = str(error).removeprefix(f"{section.rpartition('.')[2]}: ")
        raise ScenarioError(f"{section}: {message}") from error


def _Require(condition: bool, key: str, value: object, rule: str) -> None:
    if not condition:
        raise ScenarioError(f"{key} {rule}, not {value}")


def _Choice(key: str, value: str, choices: tuple[str, ...]) -> None:
    _Require(value in choices, key, repr(value), f"must be one of {', '.join(choices)}")


def _Length(key: str, value: list[float], length: int) -> None:
    _Require(len(value) == length, key, value, f"must be a list of {length} numbers")
