"""Parameters as frozen dataclasses that check types and ranges, in Python and from YAML alike.

A parameter is declared once, in the class that uses it, with its type, its range and its default::

    @parameters
    class MatchingParameters:
        min_value: Share = 0.3

`Share` and the others here are ranges that many parameters have. Wrong values raise a
`ParameterError` of one line, from ``MatchingParameters(min_value=2)`` as from a scenario file.
"""

from mffdrake.recognition.parameters.checked import (
    Coordinate,
    Count,
    Duration,
    Finite,
    Interval,
    Latency,
    Length,
    Limit,
    NonNegative,
    Number,
    ParameterError,
    Period,
    Pixels,
    Position,
    Positive,
    Seed,
    Share,
    Text,
    Vector3,
    check,
    check_fields,
    parameters,
    read_parameters,
)
from mffdrake.recognition.parameters.messages import (
    InputError,
    did_you_mean,
    shorten,
    shown,
    unknown_key,
)
from mffdrake.recognition.parameters.one_of import OneOf, choices, is_choice, kind_of, tag_of
from mffdrake.recognition.parameters.plain_data import describe, merge, plain

__all__ = [
    "Coordinate",
    "Count",
    "Duration",
    "Finite",
    "InputError",
    "Interval",
    "Latency",
    "Length",
    "Limit",
    "NonNegative",
    "Number",
    "OneOf",
    "ParameterError",
    "Period",
    "Pixels",
    "Position",
    "Positive",
    "Seed",
    "Share",
    "Text",
    "Vector3",
    "check",
    "check_fields",
    "choices",
    "describe",
    "did_you_mean",
    "is_choice",
    "kind_of",
    "merge",
    "parameters",
    "plain",
    "read_parameters",
    "shorten",
    "shown",
    "tag_of",
    "unknown_key",
]
