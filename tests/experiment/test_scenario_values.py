"""Every field of a scenario takes a value or refuses it in one line; new fields come in, too.

The fields are found by their types, those of all choices included.
"""

import dataclasses as dc
import math
import types
import typing
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from mffdrake.experiment.scenario.scenario import LoadScenario, Scenario, ScenarioError
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.recognition.parameters import Limit, choices, is_choice, kind_of, tag_of
from mffdrake.recognition.parameters.yaml_text import DumpYaml

VALUES = [
    0, -1, 1e-300, 5e-324, 1e308, -1e308, 1e30, 1e9, 2**31, 2**32, 2**63, -(2**63), 10**30,
    math.inf, -math.inf, math.nan, True, None, "", "\0", "x" * 5000, [], {}, {"_tag": "!No"},
]  # fmt: skip


class Field(NamedTuple):
    """A field: its key, with the choices that lead to it, its type, and where it is."""

    key: str
    hint: Any
    place: typing.Callable[[Any], dict]


def inside(hint):
    """What a type is made of, None and the length of a list left out."""
    return [part for part in typing.get_args(hint) if part not in (types.NoneType, ...)]


def plain_type(hint):
    """The type without ranges and None, as the class of it all and the types of its parts."""
    origin = typing.get_origin(hint)
    if origin is Annotated:
        return plain_type(typing.get_args(hint)[0])
    if origin in (typing.Union, types.UnionType) and len(inside(hint)) == 1:
        return plain_type(inside(hint)[0])
    return origin or hint, typing.get_args(hint)


def length(hint):
    """That of a list of the type, where it may have any, 1; None for what is no list."""
    kind, parts = plain_type(hint)
    return None if kind is not tuple else 1 if parts[-1] is ... else len(parts)


def hints_of(cls):
    hints = typing.get_type_hints(cls, include_extras=True)
    return {field.name: hints[field.name] for field in dc.fields(cls) if field.init}


def sample(hint):
    """A value that is right, or at least of the right type."""
    kind, parts = plain_type(hint)
    if kind is tuple:
        return [sample(parts[0])] * (4 if parts[-1] is ... else len(parts))
    return {str: "text", bool: False}.get(kind, 1)


def required(cls):
    missing = [f.name for f in dc.fields(cls) if f.default is f.default_factory is dc.MISSING]
    return {name: sample(hints_of(cls)[name]) for name in missing}


def fields_of(cls=Scenario, key="", place=lambda data: data):
    for name, hint in hints_of(cls).items():
        here = f"{key}.{name}" if key else name

        def put(value, name=name):
            return place({name: value})

        yield Field(here, hint, put)
        for kind in choices(hint):

            def put_in(data, put=put, kind=kind, hint=hint):
                tag = {"_tag": tag_of(kind)} if is_choice(hint) else {}
                data = {**tag, **required(kind), **data}
                return put(data if length(hint) is None else [data])

            below = f"{here}<{kind_of(kind)}>" if is_choice(hint) else here
            yield from fields_of(kind, below, put_in)


FIELDS = {field.key: field for field in fields_of()}


def load(field, value):
    """The scenario, or None and what is said of the value; anything else is an error."""
    try:
        return LoadScenario(text=DumpYaml(field.place(value))), ""
    except ScenarioError as error:
        return None, str(error)


def numbers(key):
    """Whether a field is a number, or a list of them."""
    kind, parts = plain_type(FIELDS[key].hint)
    if kind is tuple:
        kind, _ = plain_type(parts[0])
    return kind in (int, float)


def test_the_fields_are_found_below_choices_and_in_lists_too():
    assert len(FIELDS) > 200
    assert {
        "seed", "hand_path.omega", "camera.width", "recognizer.refinement<borders>.window",
        "disturbances<black>.starts", "target.motion<waypoints>.points.time",
        "cameras.focal<focal_length>.x", "servo<follow>.controller.gain",
    } <= set(FIELDS)  # fmt: skip


@pytest.mark.parametrize("key", FIELDS)
def test_any_value_is_taken_or_refused_in_one_short_line_that_names_the_field(key):
    field = FIELDS[key]
    values = VALUES + [[value] * length(field.hint) for value in VALUES if length(field.hint)]
    for value in values:
        scenario, message = load(field, value)
        if scenario is not None:
            assert LoadScenario(text=scenario.Dump()) == scenario
            continue
        assert message.startswith("scenario text: ")
        assert len(message.splitlines()) == 1
        assert len(message) < 500
        assert key.split(".")[-1] in message, message


@pytest.mark.parametrize("key", list(filter(numbers, FIELDS)))
def test_every_number_has_bounds_within_which_it_can_be_reckoned_with(key):
    field, count = FIELDS[key], length(FIELDS[key].hint)
    for value in (-1e308, 1e10, 1e30, 1e308, 2**63, -math.inf, math.inf, math.nan):
        if field.hint == Limit and value > 0:
            continue
        scenario, message = load(field, value if count is None else [value] * count)
        assert scenario is None or (key == "seed" and value < 2**63), value
        assert message or key == "seed"


def test_a_text_has_no_character_0_which_would_end_it_elsewhere():
    for text in ("\0", "a\0b"):
        assert "without the character" in load(FIELDS["target.model"], text)[1]


SMALL = """
renderer: flat
duration: 0.04
camera: {width: 64, height: 48}
recognizer: {population_size: 5, first_candidates: 3, refinement: borders}
"""


@pytest.mark.parametrize(
    "text",
    [
        "camera: {width: 1, height: 1, baseline: 1e-6, fov_y_deg: 0.001, latency: 1e-300}",
        "camera: {width: 16384, fov_y_deg: 179.9, p_EC: [1e3, 1e3, 1e3]}",
        "{calibration: {focal_error: 1e3, baseline_error: 1e3}, predictor: {gain: 1e9}}",
        "encoders: {noise_deg: 360, resolution_deg: 5e-324}",
        "target: {X_WM: {rotation: !AngleAxis {angle_deg: 1e9, axis: [1e-9, 0, 0]}}}",
        "target: {motion: !Sinusoids {amplitude: [1e3, 1e3, 1e3], period: [1e-6]}}",
        "disturbances: [!Brightness {offset: 1e9, amplitude: 1e9, period: 1e-6}, frozen]",
        "clutter: [!Occluder {size: [1e-6, 1e3, 1e-6], direction: [1e-9, 0, 0], period: 1e-6}]",
        "recognizer: {local_moves: {depth: 1e3, shift: 1e3, rotation_deg: 1e9, decades: 100}}",
        "recognizer: {search_range: {x: [-1e3, 1e3], z: [0.001, 1e3]}}",
        "recognizer: {refinement: !Borders {window: 1000, blend: 1000, max_shift: 1e308}}",
        "servo: !Follow {source: truth, controller: {gain: 1e9, centering: 1e9}}",
    ],
)
def test_values_at_the_bounds_can_be_reckoned_with(text):
    result = Simulate(LoadScenario(text=text, defaults=LoadScenario(text=SMALL)))
    assert result.recognized_pose.shape == (2, 6)
    for values in (result.recognized_pose, result.joint_positions, result.fitness):
        assert np.isfinite(values).all()
