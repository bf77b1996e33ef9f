"""Grids of scenarios: every combination of some keys' values, with several seeds."""

from __future__ import annotations

import dataclasses as dc
import itertools
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mffdrake.experiment.runs.engine import PlannedRun
from mffdrake.experiment.scenario.scenario import Change, Scenario, ScenarioError
from mffdrake.recognition.parameters import (
    OneOf,
    ParameterError,
    merge,
    plain,
    read_parameters,
    shorten,
    shown,
    unknown_key,
)
from mffdrake.recognition.parameters.yaml_text import DumpYaml, ReadYaml

__all__ = ["Grid", "LoadGrid", "MakeGrid"]

_KEYS = ("scenario", "grid", "seeds")
_MOST_RUNS = 100_000


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Checked runs, and what they were made of; see `LoadGrid` and `MakeGrid`.

    Attributes:
        scenario: What the runs have in common.
        values: The varied keys, dotted, and their values.
        seeds: The seeds.
        runs: The plan, labeled by the keys: the last key varies fastest, the seeds still faster.

    Example:
        >>> grid = MakeGrid({"grid": {"method": ["ga", "mff"]}, "seeds": [7, 8]})
        >>> grid.values, grid.seeds, len(grid.runs)
        ({'method': ['ga', 'mff']}, (7, 8), 4)
    """

    scenario: Scenario
    values: dict[str, list[Any]]
    seeds: tuple[int, ...]
    runs: tuple[PlannedRun, ...]

    def Dump(self) -> str:
        """The grid as YAML, complete, which `LoadGrid` reads back as the same runs."""
        scenario = plain(self.scenario)
        del scenario["seed"]
        for key in self.values:  # It is either fixed or varied.
            _Remove(scenario, key.split("."))
        data: dict[str, Any] = {"scenario": scenario, "seeds": list(self.seeds)}
        if self.values:
            data = {"scenario": scenario, "grid": self.values, "seeds": list(self.seeds)}
        return DumpYaml(data)


def LoadGrid(file: Path | str, *, scenario: Scenario | None = None) -> Grid:
    """Reads a grid file.

    It is YAML with these keys::

        scenario: {renderer: flat, duration: 20}  # what all runs have in common; may be left out
        grid:                                     # dotted keys of the scenario: lists of values
          hand_path.omega: [0.105, 0.314]
          method: [ga, mff]
        seeds: 5                                  # so many from the scenario's on, or a list

    Args:
        file: The file.
        scenario: What the file's ``scenario`` goes on top of; the defaults without.

    Returns:
        The grid, with every run checked as far as that goes without building its diagram.

    Raises:
        ScenarioError: One line that names the file, the key, the value and what is allowed.
        OSError: When the file cannot be read.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "grid.yaml"
        >>> _ = file.write_text("grid: {method: [ga, mff], hand_path.omega: [0.1, 0.3]}")
        >>> [tuple(run.labels.values()) for run in LoadGrid(file).runs]
        [('ga', 0.1), ('ga', 0.3), ('mff', 0.1), ('mff', 0.3)]
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{file}: not a text file in UTF-8") from error
    try:
        return MakeGrid(ReadYaml(text), scenario=scenario)
    except ParameterError as error:
        raise ScenarioError(f"{file}: {error}") from error


def MakeGrid(data: Mapping[str, Any], *, scenario: Scenario | None = None) -> Grid:
    """Makes a grid of what would stand in a grid file.

    Args:
        data: The keys ``scenario``, ``grid`` and ``seeds``, see `LoadGrid`.
        scenario: What ``data["scenario"]`` goes on top of; the defaults without.

    Returns:
        The grid, with every run checked.

    Raises:
        ScenarioError: One line that names the key, the value and what is allowed.

    Example:
        >>> grid = MakeGrid({"grid": {"recognizer.population_size": [30, 60]}, "seeds": [7, 8]})
        >>> [(*run.labels.values(), run.scenario.seed) for run in grid.runs]
        [(30, 7), (30, 8), (60, 7), (60, 8)]
    """
    for key in data:
        if key not in _KEYS:
            raise ScenarioError(unknown_key(key, _KEYS))
    if not data:
        raise ScenarioError(f"must be a mapping with some of the keys {', '.join(_KEYS)}")
    base = _OnTop(scenario or Scenario(), data.get("scenario", {}))
    seeds = _ReadSeeds(data.get("seeds", 1), base.seed)
    if data.get("grid") == {}:
        raise ScenarioError("grid has no keys; write such as {method: [ga, mff]}, or leave it out")
    columns = _ReadColumns(data.get("grid", {}), base)
    number = math.prod(map(len, columns.values())) * len(seeds)
    if number > _MOST_RUNS:
        raise ScenarioError(
            f"grid: that makes {number} runs, but {_MOST_RUNS} are the most; list fewer values or "
            "seeds, or part them among several files"
        )
    runs = tuple(_MakeRuns(base, columns, seeds))
    values = {key: [value for value, _ in column] for key, column in columns.items()}
    return Grid(scenario=base, values=values, seeds=seeds, runs=runs)


def _OnTop(base: Scenario, data: Any) -> Scenario:
    if not isinstance(data, dict):
        raise ScenarioError(
            f"scenario must be a mapping such as {{duration: 20}}, not {shown(data)}"
        )
    try:
        return read_parameters(Scenario, merge(base, data))
    except ParameterError as error:
        raise ScenarioError(f"scenario: {error}") from error


def _ReadSeeds(data: Any, first: int) -> tuple[int, ...]:
    """The seeds: a number of them, or a list."""
    if type(data) is int and data >= 1:
        if data > _MOST_RUNS:
            raise ScenarioError(f"seeds must be at most {_MOST_RUNS}, not {shown(data)}")
        seeds = list(range(first, first + data))
    elif isinstance(data, list) and data and all(type(seed) is int for seed in data):
        seeds = data
    else:
        raise ScenarioError(
            f"seeds must be a positive whole number or a list of whole numbers, not {shown(data)}"
        )
    for seed in seeds:
        if not 0 <= seed < 2**63:
            raise ScenarioError(f"seeds: a seed must be at least 0 and below 2^63, not {seed}")
    _RequireDistinct(seeds, "seeds: the list")
    return tuple(seeds)


# Values as the scenario writes them, with what is wrong with those that are no good by themselves;
# together with other keys' values they may be.
_Column = list[tuple[Any, ScenarioError | None]]


def _ReadColumns(data: Any, base: Scenario) -> dict[str, _Column]:
    """The varied keys' values."""
    if not isinstance(data, dict):
        raise ScenarioError(
            f"grid must be a mapping such as {{method: [ga, mff]}}, not {shown(data)}"
        )
    columns: dict[str, _Column] = {}
    for key, values in data.items():
        if not isinstance(key, str):
            raise ScenarioError(f"grid: a key must be a scenario's key, not {shown(key)}")
        if key == "seed":
            raise ScenarioError("grid: 'seed' cannot be varied here; list the values as 'seeds'")
        for other in columns:
            if f"{key}.".startswith(f"{other}.") or f"{other}.".startswith(f"{key}."):
                raise ScenarioError(
                    f"grid: {shown(key)} and {shown(other)} overlap; vary one of them"
                )
        if not isinstance(values, list) or not values:
            # So that a wrong key shows as such, whatever its value.
            _CheckKey(key, base)
            what = "an empty list" if values == [] else shown(values)
            raise ScenarioError(f"grid: {shorten(key)} must be a list of values, not {what}")
        columns[key] = [_ReadValue(key, value, base) for value in values]
        _RequireDistinct([value for value, _ in columns[key]], f"grid: {shorten(key)}")
    return columns


def _RequireDistinct(values: list[Any], what: str) -> None:
    seen = set()
    for value in map(json.dumps, values):
        if value in seen:
            raise ScenarioError(f"{what} has the value {shorten(value)} twice")
        seen.add(value)


def _CheckKey(key: str, base: Scenario) -> None:
    try:
        Change(base, {key: None})
    except ScenarioError as error:
        if str(error).startswith("unknown key"):
            raise ScenarioError(f"grid: {shorten(key)}: {error}") from error


def _ReadValue(key: str, value: Any, base: Scenario) -> tuple[Any, ScenarioError | None]:
    try:
        return _Find(plain(Change(base, {key: value})), key, value), None
    except ScenarioError as error:
        message = str(error)
        where = "" if message.startswith(f"{key} ") else f"{shorten(key)}: "
        return value, ScenarioError(f"grid: {where}{message}")


def _Find(data: Any, key: str, value: Any) -> Any:
    """What stands under a dotted key; below a choice at its defaults, the value that is given."""
    for name in key.split("."):
        if isinstance(data, str):
            return value
        data = data[name]
    return data


def _Remove(data: dict[str, Any], names: list[str]) -> None:
    """Removes an entry of nested mappings, and those that it leaves empty."""
    if OneOf.TAG in data:  # It might not be complete without.
        return
    first, *rest = names
    if rest and isinstance(data[first], dict):
        _Remove(data[first], rest)
    if not rest or not data[first]:
        del data[first]


def _MakeRuns(
    base: Scenario, columns: dict[str, _Column], seeds: tuple[int, ...]
) -> Iterator[PlannedRun]:
    """All runs, in order."""
    for combination in itertools.product(*columns.values()):
        values = {key: value for key, (value, _) in zip(columns, combination, strict=True)}
        try:
            scenario = Change(base, values)
        except ScenarioError as error:
            for _, alone in combination:
                if alone is not None:
                    raise alone from error
            words = ", ".join(
                f"{key} {shorten(json.dumps(value))}" for key, value in values.items()
            )
            raise ScenarioError(f"grid: with {words}: {error}" if words else str(error)) from error
        for seed in seeds:
            yield PlannedRun(labels=values, scenario=dc.replace(scenario, seed=seed))
