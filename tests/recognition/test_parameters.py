"""Parameters: frozen, checked alike in Python and from YAML, with clear words for what is wrong."""

import dataclasses as dc
import json
import math
import typing
from typing import Annotated, ClassVar, Literal

import numpy as np
import pytest

from mffdrake.recognition import ParameterError, TrackerParameters
from mffdrake.recognition.parameters import (
    Count,
    Finite,
    InputError,
    Interval,
    NonNegative,
    OneOf,
    Positive,
    Seed,
    Share,
    Vector3,
    choices,
    describe,
    kind_of,
    merge,
    parameters,
    plain,
    read_parameters,
    tag_of,
)


@parameters
class Silence:
    """No sound, and no parameters."""


@parameters
class Tone:
    """A tone.

    Attributes:
        pitch: Its frequency
            [Hz].
    """

    pitch: Positive = 440.0


@parameters
class SoftNoise:
    """Has a parameter without a default.

    Attributes:
        color: What it is like.
    """

    kind: ClassVar[str] = "noise"

    color: Literal["white", "pink"]
    share: Share = 0.5


@parameters
class Box:
    """A box.

    Attributes:
        size: Its edges.
    """

    size: Vector3 = (1.0, 2.0, 3.0)


@parameters
class Loud:
    """The other parent.

    Attributes:
        volume: How loud.
        repeat: How often, a parent says.
    """

    volume: NonNegative = 1.0
    repeat: Count = 1

    def __post_init__(self):
        """Checks both together."""
        if self.volume * self.repeat > 100:
            raise ValueError("volume and repeat must not exceed 100 together")


@parameters
class Player(Loud, Box):
    """Has two parents.

    Attributes:
        sound: What it plays.
        sounds: And then.
        repeat: How often.
    """

    sound: Annotated[Silence | Tone | SoftNoise, OneOf()] = dc.field(default_factory=Silence)
    sounds: tuple[Annotated[Silence | Tone | SoftNoise, OneOf()], ...] = ()
    case: Box = dc.field(default_factory=Box)
    window: Interval | None = None
    offset: Finite = 0.0
    seed: Seed = 0
    name: str = "player"
    mono: bool = False


ODD = Player(
    volume=0.1 + 0.2,
    repeat=3,
    size=(1e-300, math.pi, -1e9 / 3),
    sound=SoftNoise(color="pink", share=1 / 3),
    sounds=(Tone(), Silence(), SoftNoise(color="white"), Tone(pitch=1.1e-9)),
    case=Box(size=(0.1, 0.7, np.nextafter(1.0, 2.0))),
    window=(-1 / 3, 2 / 3),
    offset=-0.0,
    seed=2**63 - 1,
    name="1e3",
    mono=True,
)


def error_of(make):
    with pytest.raises(ParameterError) as caught:
        make()
    (line,) = str(caught.value).splitlines()
    return line


# Plain data and back.


@pytest.mark.parametrize("value", [Player(), ODD], ids=["default", "odd"])
def test_plain_data_reads_back_as_the_same_to_the_last_bit(value):
    data = plain(value)
    again = read_parameters(Player, json.loads(json.dumps(data)))
    assert again == value and hash(again) == hash(value)
    assert repr(again) == repr(value)  # Tells -0.0 from 0.0, and ints from floats.
    assert plain(again) == data


def test_plain_data_has_tags_where_there_is_a_choice_and_short_names_where_they_say_it_all():
    assert plain(ODD)["sound"] == {"_tag": "!Noise", "color": "pink", "share": 1 / 3}
    assert plain(ODD)["sounds"] == [
        "tone", "silence", {"_tag": "!Noise", "color": "white", "share": 0.5},
        {"_tag": "!Tone", "pitch": 1.1e-9},
    ]  # fmt: skip
    assert plain(ODD)["case"] == {"size": [0.1, 0.7, 1.0000000000000002]}
    assert plain(Tone()) == {"pitch": 440.0}


def test_names_and_tags_come_of_the_class_or_of_its_kind():
    assert [kind_of(kind) for kind in (Silence, SoftNoise, Player)] == [
        "silence",
        "noise",
        "player",
    ]
    assert [tag_of(kind) for kind in (Silence, SoftNoise)] == ["!Silence", "!Noise"]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("silence", Silence()),
        ("tone", Tone()),
        ({}, Silence()),
        ({"_tag": "!Silence"}, Silence()),
        ({"_tag": "!Tone"}, Tone()),
        ({"_tag": "!Tone", "pitch": 3}, Tone(pitch=3.0)),
        ({"_tag": "!Noise", "color": "pink"}, SoftNoise(color="pink")),
    ],
)
def test_a_choice_is_made_by_a_name_or_a_tag(data, expected):
    assert read_parameters(Player, {"sound": data}).sound == expected
    assert read_parameters(Player, {"sounds": [data, "tone"]}).sounds == (expected, Tone())


@pytest.mark.parametrize(
    "data",
    [
        "noise",
        "tune",
        "Tone",
        "!Tone",
        3,
        True,
        None,
        [],
        ["tone"],
        {"pitch": 3},
        {"_tag": "!Tune"},
    ],
)
def test_what_is_no_choice_is_told_all_of_them(data):
    message = error_of(lambda: read_parameters(Player, {"sound": data}, "player"))
    allowed = "silence, tone, !Tone {...}, !Noise {color: ...}"
    assert message.startswith(f"player.sound must be one of {allowed}, not ")
    assert "_tag" not in message


def test_choices_are_the_classes_that_a_parameter_can_be_of():
    assert choices(float) == () and choices(Box) == (Box,)
    assert choices(Box | None) == (Box,)
    assert choices(tuple[Annotated[Tone | Box, OneOf()], ...]) == (Tone, Box)


# On top of others.


@pytest.mark.parametrize(
    ("base", "data", "expected"),
    [
        (ODD, {}, ODD),
        (ODD, {"repeat": 4}, dc.replace(ODD, repeat=4)),
        (ODD, {"case": {}}, ODD),
        (ODD, {"size": [1, 2, 3]}, dc.replace(ODD, size=(1.0, 2.0, 3.0))),
        (ODD, {"window": None}, dc.replace(ODD, window=None)),
        # Without a tag: of the class that is there. With one: in place of it.
        (
            ODD,
            {"sound": {"color": "white"}},
            dc.replace(ODD, sound=SoftNoise(color="white", share=1 / 3)),
        ),
        (
            ODD,
            {"sound": {"_tag": "!Noise", "color": "white"}},
            dc.replace(ODD, sound=SoftNoise(color="white")),
        ),
        (ODD, {"sound": "tone"}, dc.replace(ODD, sound=Tone())),
        (ODD, {"sound": {}}, dc.replace(ODD, sound=Silence())),
        (ODD, {"sounds": ["tone"]}, dc.replace(ODD, sounds=(Tone(),))),
    ],
)
def test_plain_data_goes_on_top_of_parameters_key_by_key(base, data, expected):
    before = json.dumps(data)
    assert read_parameters(Player, merge(base, data)) == expected
    assert json.dumps(data) == before


def test_unknown_keys_survive_until_they_are_told():
    merged = merge(Player(), {"case": {"sise": 3}})
    assert error_of(lambda: read_parameters(Player, merged)) == (
        "unknown key 'sise' in case (did you mean 'size'?); known keys: size"
    )


# What is wrong is told alike from plain data and in Python.


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("volume", -1, "volume must be at least 0, not -1"),
        ("volume", math.nan, "volume must be finite, not nan"),
        ("volume", math.inf, "volume must be finite, not inf"),
        ("volume", "3", "volume must be a number, not '3'"),
        ("volume", True, "volume must be a number, not True"),
        ("volume", None, "volume must be a number, not None"),
        ("volume", [1.0], "volume must be a number, not [1.0]"),
        ("repeat", 0, "repeat must be at least 1, not 0"),
        ("repeat", 1.5, "repeat must be a whole number, not 1.5"),
        ("repeat", 2.0, "repeat must be a whole number, not 2.0"),
        ("repeat", True, "repeat must be a whole number, not True"),
        ("repeat", "2", "repeat must be a whole number, not '2'"),
        ("seed", -1, "seed must be at least 0, not -1"),
        ("seed", 2**63, f"seed must be below 2^63, not {2**63}"),
        ("offset", -math.inf, "offset must be finite, not -inf"),
        ("name", 3, "name must be a text, not 3"),
        ("mono", 1, "mono must be true or false, not 1"),
        ("mono", "yes", "mono must be true or false, not 'yes'"),
        ("size", [1, 2], "size must be a list of 3 values, not [1, 2]"),
        ("size", [1, 2, 3, 4], "size must be a list of 3 values, not [1, 2, 3, 4]"),
        ("size", [], "size must be a list of 3 values, not []"),
        ("size", "123", "size must be a list, not '123'"),
        ("size", 3, "size must be a list, not 3"),
        ("size", [1, "2", 3], "size[1] must be a number, not '2'"),
        ("size", [1, 2, math.nan], "size[2] must be finite, not nan"),
        ("size", [1, True, 3], "size[1] must be a number, not True"),
        ("window", [1], "window must be a list of 2 values, not [1]"),
        ("repeat", 101, "volume and repeat must not exceed 100 together"),
    ],
)
def test_a_wrong_value_is_one_line_with_the_key_what_is_allowed_and_the_value(name, value, message):
    assert error_of(lambda: read_parameters(Player, {name: value})) == message
    assert error_of(lambda: Player(**{name: value})) == f"Player: {message}"
    assert error_of(lambda: dc.replace(Player(), **{name: value})) == f"Player: {message}"
    joined = message if message.startswith("volume and") else None
    below = error_of(lambda: read_parameters(Player, {name: value}, "a.b"))
    assert below == (f"a.b: {joined}" if joined else f"a.b.{message}")


def test_what_a_section_below_finds_is_told_with_its_key():
    data = {"sounds": ["tone", {"_tag": "!Noise", "color": "red", "share": 2}]}
    assert error_of(lambda: read_parameters(Player, data, "player")) == (
        "player.sounds[1].color must be one of white, pink, not 'red'"
    )
    assert error_of(lambda: SoftNoise()) == "SoftNoise: color must be given"
    data = {"sound": {"_tag": "!Noise"}}
    assert error_of(lambda: read_parameters(Player, data)) == "sound.color must be given"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"volum": 3}, "unknown key 'volum' (did you mean 'volume'?); known keys: size, volume, "),
        ({"xyz": 3}, "unknown key 'xyz'; known keys: size, volume, repeat, sound, "),
        (
            {"sound": {"_tag": "!Tone", "pich": 3}},
            "unknown key 'pich' in sound (did you mean 'pitch'?); known keys: pitch",
        ),
        ({"sound": {"_tag": "!Silence", "a": 3}}, "unknown key 'a' in sound; known keys: none"),
        ({"case": {"_tag": "!Box"}}, "case must be a mapping with the keys size, without a tag, "),
        ([1], "must be a mapping with the keys size, volume, "),
        (None, "must be a mapping with the keys size, volume, "),
        ({"case": 3}, "case must be a mapping with the keys size, not 3"),
        ({"case": None}, "case must be a mapping with the keys size, not None"),
    ],
)
def test_a_wrong_key_or_no_mapping_is_told_the_keys(data, message):
    assert error_of(lambda: read_parameters(Player, data)).startswith(message)


def test_an_unknown_name_in_python_is_an_error():
    assert "volum" in error_of(lambda: Player(volum=3))
    with pytest.raises(TypeError):
        Player(3)


# In Python.


def test_numpys_numbers_and_arrays_are_accepted_and_become_pythons():
    player = Player(
        volume=np.float32(0.5),
        repeat=np.int64(3),
        mono=np.bool_(True),
        size=np.arange(3),
        window=[np.float64(0.1), 2],
        sounds=[Tone(pitch=np.array(3.0))],
    )
    assert player == Player(
        volume=0.5, repeat=3, mono=True, size=(0, 1, 2), window=(0.1, 2), sounds=(Tone(pitch=3),)
    )
    numbers = (player.volume, player.repeat, player.mono, *player.size, *player.window)
    assert [type(number) for number in numbers] == [float, int, bool, *3 * [float], *2 * [float]]
    assert read_parameters(Player, {"repeat": np.int64(3), "size": np.ones(3)}) == Player(
        repeat=3, size=(1, 1, 1)
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [("volume", np.bool_(True)), ("repeat", np.float64(2.0)), ("size", np.ones((3, 1)))],
)
def test_numpys_numbers_are_checked_like_pythons(name, value):
    assert name in error_of(lambda: Player(**{name: value}))


def test_they_are_frozen_all_the_way_down_and_can_be_in_sets():
    player = Player()
    with pytest.raises(dc.FrozenInstanceError):
        player.volume = 3
    with pytest.raises(dc.FrozenInstanceError):
        player.case.size = (1, 2, 3)
    size = [1.0, 2.0, 3.0]
    box = Box(size=size)
    size[0] = 9.0
    assert box.size == (1.0, 2.0, 3.0)
    assert len({player, Player(), Player(volume=2)}) == 2


def test_replacing_checks_again_and_leaves_the_first_as_it_is():
    player = Player(volume=2)
    assert dc.replace(player, repeat=50).repeat == 50
    assert error_of(lambda: dc.replace(player, repeat=51)).startswith("Player: volume and repeat")
    assert player == Player(volume=2)


def test_a_subclass_has_the_parameters_and_checks_of_both_parents():
    assert {"volume", "repeat", "size", "sound"} <= {field.name for field in dc.fields(Player)}
    player = Player(size=[3, 2, 1], volume=3)
    assert isinstance(player, Loud) and isinstance(player, Box)
    assert (player.size, player.volume) == ((3.0, 2.0, 1.0), 3.0)
    assert error_of(lambda: Player(volume=101)) == (
        "Player: volume and repeat must not exceed 100 together"
    )


def test_an_instance_of_a_wrong_class_is_an_error():
    assert error_of(lambda: Player(case=3)) == "Player: case must be a Box, not 3"
    assert error_of(lambda: Player(case=Tone())).startswith("Player: case must be a Box, not Tone(")
    assert "sound must be one of silence, tone, " in error_of(lambda: Player(sound=Box()))
    assert Player(sound=Tone(pitch=3)).sound.pitch == 3.0


def test_errors_are_value_errors():
    assert issubclass(ParameterError, ValueError)


# What they are.


def test_descriptions_come_from_the_docstrings_of_the_class_and_its_parents():
    assert describe(Tone) == {"pitch": "Its frequency [Hz]."}
    assert describe(Silence) == {}
    assert describe(Player) == {
        "size": "Its edges.", "volume": "How loud.", "repeat": "How often.",
        "sound": "What it plays.", "sounds": "And then.",
    }  # fmt: skip


def parameter_classes(cls=TrackerParameters):
    """A class of parameters and all those below it."""
    found = {cls: None}
    for field in dc.fields(cls):
        for kind in choices(typing.get_type_hints(cls)[field.name]):
            found |= parameter_classes(kind)
    return found


@pytest.mark.parametrize("cls", parameter_classes(), ids=lambda cls: cls.__name__)
def test_every_parameter_of_the_recognizer_is_described_checked_and_written(cls):
    assert set(describe(cls)) == {field.name for field in dc.fields(cls)}
    made = cls()
    assert read_parameters(cls, plain(made)) == made
    for field in dc.fields(cls):
        name = field.name
        assert name in error_of(lambda name=name: cls(**{name: object()}))
        assert name in error_of(lambda name=name: read_parameters(cls, {name: [{"a": "b"}]}))


@pytest.mark.parametrize("length", [1500, 1501, 1502, 5000])
def test_a_message_is_at_most_1500_characters(length):
    words = "ab" * (length // 2) + "c" * (length % 2)
    message = str(InputError(words))
    assert message == words if length <= 1500 else len(message) in (1499, 1500)
    assert message[:100] == words[:100] and message[-100:] == words[-100:]
