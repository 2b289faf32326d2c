"""Typed parameters: what is taken, what is refused, and that the refusal names owner, key and remedy."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evis.config.params import Param, ParamError, limits, resolve

DECLARED = {
    "threshold": Param(float, 0.2, "contrast threshold", minimum=0.01, maximum=5.0),
    "upsampling": Param(int, 8, "sub-frames per gap", minimum=1),
    "method": Param(str, "splat", "interpolator", choices=("splat", "rigid", "none")),
    "shadows": Param(bool, True, "cast shadows"),
    "topics": Param(list, [], "globs"),
    "serial": Param(str, None, "device", optional=True),
    "rate": Param(float, 1.0, "frames per second", minimum=0.5, words=("auto",)),
    "name": Param(str, "", "what it is called"),
}


@pytest.mark.parametrize(
    ("given_", "key", "expected"),
    [
        ({"threshold": "0.15"}, "threshold", 0.15),
        ({"threshold": 1}, "threshold", 1.0),
        ({"upsampling": "16"}, "upsampling", 16),
        ({"upsampling": 16.0}, "upsampling", 16),
        ({"upsampling": str(2**60 + 1)}, "upsampling", 2**60 + 1),
        ({"shadows": "off"}, "shadows", False),
        ({"topics": "/a/*, /b"}, "topics", ["/a/*", "/b"]),
        ({"serial": None}, "serial", None),
        ({}, "method", "splat"),
        ({"rate": "auto"}, "rate", "auto"),
        ({"rate": "2"}, "rate", 2.0),
        ({"name": True}, "name", "true"),
        ({"name": False}, "name", "false"),
        ({"name": 1.5}, "name", "1.5"),
    ],
)
def test_taken(given_: dict, key: str, expected: object) -> None:
    value = resolve("node", DECLARED, given_)[key]
    assert value == expected and type(value) is type(expected)


@pytest.mark.parametrize(
    ("given_", "words"),
    [
        ({"treshold": 0.2}, ["sensor", "treshold", "did you mean 'threshold'"]),
        ({"threshold": "high"}, ["sensor", "threshold", "must be a number"]),
        ({"threshold": math.nan}, ["threshold", "finite"]),
        ({"threshold": True}, ["threshold", "must be a number"]),
        ({"threshold": 9}, ["threshold", "the most is 5"]),
        ({"upsampling": 0}, ["upsampling", "the least is 1"]),
        ({"upsampling": 2.5}, ["upsampling", "whole number"]),
        ({"upsampling": "1e400"}, ["upsampling", "whole number"]),
        ({"method": "splatt"}, ["method", "did you mean 'splat'"]),
        ({"shadows": "maybe"}, ["shadows", "true or false"]),
        ({"topics": 3}, ["topics", "a list"]),
        ({"rate": "autos"}, ["rate", "must be a number or auto"]),
        ({"rate": 0.1}, ["rate", "the least is 0.5"]),
        ({"upsampling": "auto"}, ["upsampling", "must be a whole number"]),
        ({"name": None}, ["name is null, must be a text"]),
        ({"method": True}, ["method is 'true', must be one of"]),
        ({"shadows": None}, ["shadows is null, must be true or false"]),
        ({"threshold": True}, ["threshold is true, must be a number"]),
    ],
)
def test_refused(given_: dict, words: list[str]) -> None:
    with pytest.raises(ParamError) as error:
        resolve("sensor", DECLARED, given_)
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize("key", ["threshold", "upsampling", "method", "shadows"])
def test_a_long_value_is_shown_in_part(key: str) -> None:
    with pytest.raises(ParamError) as error:
        resolve("sensor", DECLARED, {key: "x" * 5000})
    assert f"{key} is 'xxx" in str(error.value) and len(str(error.value)) < 200


@pytest.mark.parametrize(
    ("least", "most", "text"),
    [(None, None, "s"), (0.5, None, "0.5 or more s"), (0.5, 2, "0.5 to 2 s"), (None, 2, "at most 2 s")],
)
def test_a_range_is_described_at_both_its_ends(least: float | None, most: float | None, text: str) -> None:
    assert limits(Param(float, 1.0, "how long", "s", least, most)) == text


@given(st.sampled_from(sorted(DECLARED)), st.one_of(st.none(), st.text(), st.floats(), st.lists(st.integers())))
def test_nothing_but_a_param_error(key: str, value: object) -> None:
    try:
        resolve("node", DECLARED, {key: value})
    except ParamError:
        pass
