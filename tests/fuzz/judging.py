"""What the properties share: how many cases, what counts as a clear error, and odd values.

``make fuzz`` sets MFFDRAKE_FUZZ_CASES; without it, each property tries a few cases, always the
same ones.
"""

import functools
import math
import os
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import mffdrake as mff
from mffdrake.recognition import BLUE, GREEN, RED
from mffdrake.recognition.parameters import InputError

ROOT = Path(__file__).parents[2]
CASES = int(os.environ.get("MFFDRAKE_FUZZ_CASES", "0"))
FEW = 30  # cases of a property in the normal tests
LONGEST = 1000  # characters of a message
WIDTH, HEIGHT = 64, 48  # of the images [px]

_SHARED = {
    "deadline": None,
    "suppress_health_check": list(HealthCheck),
    "database": None,
    "print_blob": True,
}
settings.register_profile("few", derandomize=True, max_examples=FEW, **_SHARED)
settings.register_profile("many", max_examples=max(1, CASES), **_SHARED)
settings.load_profile("many" if CASES else "few")

_tried = [0]


def tried():
    """How many cases were tried in this process."""
    return _tried[0]


def prop(*strategies, share=1.0, least=5, **named):
    """Makes a test a property of what the strategies draw.

    Args:
        strategies: Of the test's arguments.
        share: How many cases of the usual number: slow properties have fewer.
        least: But at least so many.
        named: Of arguments by name.
    """

    def decorate(test):
        @functools.wraps(test)
        def counted(*args, **kwargs):
            _tried[0] += 1
            return test(*args, **kwargs)

        number = max(least, math.ceil(share * (CASES or FEW)))
        # To make a failing case smaller takes as long as to find it; the short run just tells.
        phases = [phase for phase in Phase if CASES or phase != Phase.shrink]
        return settings(max_examples=number, phases=phases)(given(*strategies, **named)(counted))

    return decorate


def outcome(function, *args, error=InputError, **kwargs):
    """What a function returns; or None where it refuses with one clear error.

    Args:
        function: The function.
        args: Its arguments.
        error: What it says that it raises. ValueError stands for itself and for the package's own
            errors, not for those of numpy and others, which say nothing to whoever made the input.
        kwargs: Its named arguments.
    """
    try:
        return function(*args, **kwargs)
    except error as told:
        assert isinstance(told, InputError) or type(told) is ValueError, repr(told)
        check_message(str(told))
        return None


def check_message(message):
    """A message is one line, not too long, and says something."""
    assert 10 < len(message) < LONGEST, (len(message), message)
    assert len(message.splitlines()) == 1, message
    assert "Traceback" not in message and "object at 0x" not in message, message


ODD_NUMBERS = st.sampled_from(
    [
        0.0, -0.0, 1.0, -1.0, 0.5, 1e-3, 1e-9, 1e-160, 5e-324, 1e9, 1e18, 1e19, 1e150, 1e155,
        1.7e308, -1e9, -1e155, -1.7e308, math.inf, -math.inf, math.nan,
    ]
)  # fmt: skip
NUMBERS = st.one_of(ODD_NUMBERS, st.floats(), st.floats(-3.0, 3.0))

ODD_TEXTS = st.sampled_from(
    [
        "", " ", "~", "null", "true", "no", "-1", "0", "1e400", ".nan", ".inf", "-.inf", "010",
        "1_000", "999999999999999999999999", "9" * 400, "{}", "[]", "[[[]]]", "{a: 1}", "!Foo {}",
        "!Rpy {deg: [0, 0, .nan]}", "!!int 3", "!!python/object:os.system x", "&a [*a]", "*a",
        "'\\0'", '"\\0"', '"\\ud800"', "x" * 3000, "ü", "\u2028", "2026-11-30", "?", "- 1", "|\n a",
        "<<", "_tag", "[1, 2, 3]", "[.inf, 0, 0]", "'..'", "/", "/dev/null", "!Follow {}",
    ]
)  # fmt: skip


@st.composite
def mutated(draw, texts, words=ODD_TEXTS):
    """A text, or bytes, with a few things cut, doubled, swapped or replaced.

    Args:
        draw: Hypothesis's.
        texts: What to begin with.
        words: What to put in.
    """
    text = draw(st.sampled_from(texts))
    is_text = isinstance(text, str)
    for _ in range(draw(st.integers(1, 4))):
        i = draw(st.integers(0, len(text)))
        j = min(len(text), i + draw(st.sampled_from([0, 1, 2, 4, 8, 40, 400])))
        kind = draw(st.sampled_from(["cut", "end", "double", "put", "word", "swap"]))
        if kind == "cut":
            text = text[:i] + text[j:]
        elif kind == "end":
            text = text[:i]
        elif kind == "double":
            text = text[:j] + text[i:]
        elif kind == "swap":
            other = draw(st.sampled_from(texts))
            k = draw(st.integers(0, len(other)))
            text = text[:i] + other[k : k + j - i] + text[j:]
        elif is_text:
            if kind == "word":  # in place of a whole one
                i = max(text.rfind(mark, 0, i) for mark in " \n,[:") + 1
                j = min([k for k in (text.find(m, i) for m in " \n,]:}") if k >= 0] or [len(text)])
            put = draw(words if kind == "word" else st.one_of(words, st.text(max_size=5)))
            text = text[:i] + put + text[j:]
        else:
            put = draw(st.binary(max_size=8))
            text = text[:i] + put + text[i + len(put) :]
    return text


def vectors(size, elements=NUMBERS):
    """Vectors of odd numbers."""
    return st.lists(elements, min_size=size, max_size=size).map(np.array)


@functools.cache
def box():
    """The paper's box."""
    return mff.SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))


@functools.cache
def matcher():
    """Of the box, in small stereo images."""
    rig = mff.CameraRig.stereo(width=WIDTH, height=HEIGHT)
    return mff.Matcher(mff.SearchModel(box()), rig)
