"""YAML: what everybody takes for numbers and texts, written and read back, and cheap to refuse."""

import itertools
import math

import pytest

from mffdrake.recognition.parameters import InputError, ParameterError, shown
from mffdrake.recognition.parameters.yaml_text import DumpYaml, ReadYaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0), ("-12", -12), ("1.", 1.0), (".5", 0.5), ("-.5", -0.5), ("1e-3", 1e-3),
        ("1E5", 1e5), ("-1.5e+3", -1500.0), (".inf", math.inf), ("-.inf", -math.inf),
        ("true", True), ("False", False), ("null", None), ("~", None), ("", None),
        ("'3'", "3"),
    ],
)  # fmt: skip
def test_numbers_truths_and_nothing(text, value):
    read = ReadYaml(f"a: {text}")["a"]
    assert (type(read), read) == (type(value), value)
    assert math.isnan(ReadYaml("a: .nan")["a"])


@pytest.mark.parametrize(
    "text",
    [
        "1:30", "190:20:30.15", "1_000", "1_0.5", "+1", "+.5", "010", "00.5", "0x1F", "0b1",
        "yes", "no", "on", "off", "Yes", "y", "2020-01-01", "2020-01-01 10:00:00", "=",
    ],
)  # fmt: skip
def test_what_only_yaml_1_1_takes_for_more_is_a_text(text):
    assert ReadYaml(f"a: {text}") == {"a": text}
    assert ReadYaml(f"{text}: a") == {text: "a"}


def test_every_text_is_read_back_as_it_was_written():
    """Above all those that look like numbers."""
    letters = itertools.chain.from_iterable(
        itertools.product("01-+.e_:yn~", repeat=length) for length in range(4)
    )
    texts = ["".join(text) for text in letters]
    texts += ["true", "off", "NULL", "<<", "-.inf", ".NaN", "-.5e3", "0o7", "!a", "&a", "# a", "\0"]
    again = ReadYaml(DumpYaml({"texts": texts, "keys": dict.fromkeys(texts, 1)}))
    assert again == {"texts": texts, "keys": dict.fromkeys(texts, 1)}


@pytest.mark.parametrize("number", [1e-5, 5e-324, 1e308, -0.0, 1e16, -math.inf, -(10**30), True])
def test_every_number_is_read_back_to_the_last_bit(number):
    assert repr(ReadYaml(DumpYaml({"a": number}))["a"]) == repr(number)


def nested(before, after, levels):
    return before * levels + after * levels


def growing(form, levels):
    """Anchors, each of which stands for ten of the one before."""
    lines = ["a0: &a0 {x: 1}"]
    lines += [
        f"a{k}: &a{k} {form.format(', '.join([f'*a{k - 1}'] * 10))}" for k in range(1, levels)
    ]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: !!timestamp y", "line 1, column 4: !!timestamp is no tag that is known here"),
        ("a: !!int abc", "!!int is no tag.*write the value without it"),
        ("a: !!float x", "!!float is no tag"),
        ("a: !!bool maybe", "!!bool is no tag"),
        ("a: !!python/object:os.system x", "!!python/object:os.system is no tag"),
        ("a: !<tag:yaml.org,2002:int> x", "!!int is no tag"),
        ("a: !Borders 3", "!Borders must be followed by a mapping"),
        ("a: {_tag: [1]}", r"a tag must be a text such as !Rpy, not \[1\]"),
        ("{[1]: 2}", "line 1, column 2: a key must be a text"),
        ("{a: 1, a: 2}", "the key 'a' stands there twice"),
        ("a: " + nested("[", "]", 51), "line 1, column 53: nested too deeply; 50 levels"),
        ("a: " + nested("[", "]", 100_000), "nest"),
        (nested("{a: ", "}", 2_000), "nest"),
        ("\n".join(" " * k + "a:" for k in range(999)), "nest"),
        ("a:\n" + "- " * 900 + "1", "nest"),
        ("a: " + "1" * 5_000, "a number must have at most 300 digits, not 5000"),
        ("a: &a [*a]", "aliases"),
        (growing("[{}]", 40), "line 6, column 5: aliases make more than 100000 values"),
        (growing("{{<<: [{}]}}", 40), "aliases"),
        ("\n".join(f"b{k}: &b{k} [{f'*b{k - 1}' * (k > 0)}]" for k in range(2_000)), "50 levels"),
        ("a: \udcff", "not a text in UTF-8"),
        ("a" * 3_000, "must be a mapping such as 'seed: 3', not 'a+[.]{3}$"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_one_short_line(text, message):
    with pytest.raises(ParameterError, match=message) as caught:
        ReadYaml(text)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 300


def test_aliases_stand_for_what_they_name():
    text = "a: &a {x: 1}\nb: *a\nc: {<<: *a, y: 2}\nd: [*a, *a]"
    x = {"x": 1}
    assert ReadYaml(text) == {"a": x, "b": x, "c": {"x": 1, "y": 2}, "d": [x, x]}


def test_a_message_shows_no_more_of_a_value_than_is_of_use():
    assert shown("long") == "'long'"
    assert shown((1, 2)) == "[1, 2]"
    assert shown("x" * 5_000) == "'" + "x" * 99 + "..."
    assert shown(10**5_000) == "a number of thousands of digits"


def test_a_message_is_one_line_of_bounded_length():
    assert str(InputError("a key\nof two lines")) == r"a key\nof two lines"
    assert len(str(InputError("x" * 100_000))) < 2_000
