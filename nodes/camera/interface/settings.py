"""Declares the settings of each camera family once, with default, unit and range."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from evis.config.params import in_full
from evis.config.suggestions import nearest

LONGEST_TEXT = 200
"""Most characters of a setting's name and of its value in a message."""


def setting(
    default: Any,
    help: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    live: bool = True,
) -> Any:
    """Makes a field of a configuration from its default, help text, unit and inclusive range.

    live: it can be changed while the camera streams.
    """
    facts = {"help": help, "unit": unit, "minimum": minimum, "maximum": maximum, "live": live}
    return field(default=default, metadata=facts)


@dataclass
class Configuration:
    """Checks the settings of a camera family, which are a dataclass of `setting` fields."""

    def check(self) -> None:
        """Raises ValueError where a setting is out of range; the text names the setting, its range and its unit."""
        for f in dataclasses.fields(self):
            value, unit = getattr(self, f.name), f.metadata["unit"]
            low, high = f.metadata["minimum"], f.metadata["maximum"]
            if value is None:  # not given: as the device has it
                continue
            if isinstance(value, (int, float)) and not math.isfinite(value):
                raise ValueError(f"{f.name} is {value}; it must be finite")
            if (low is not None and value < low) or (high is not None and value > high):
                span = f"at least {in_full(low)}" if high is None else f"{in_full(low)} to {in_full(high)}"
                raise ValueError(
                    f"{f.name} is {in_full(value)} {unit}; it must be {span} {unit}".replace(" ;", ";").rstrip()
                )

    def changed_by(self, values: Mapping[str, Any]) -> Any:
        """Returns a checked configuration that has `values` in place of its own, for a camera that streams.

        Raises ValueError as `of` does, and for a setting that is decided when the camera starts.
        """
        live = [f.name for f in dataclasses.fields(self) if f.metadata["live"]]
        for f in dataclasses.fields(self):
            if f.name in values and f.name not in live and values[f.name] != getattr(self, f.name):
                can = f"while it streams {', '.join(live)} can change" if live else "nothing of it can change"
                raise ValueError(f"{f.name} is decided when the camera starts, by settings:=; {can}")
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return type(self).of(own | dict(values))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Any:
        """Makes a checked configuration. Raises ValueError with the nearest name for an unknown one."""
        names = [f.name for f in dataclasses.fields(cls)]
        for name in values:
            if name not in names:
                raise ValueError(f"no setting '{name}'; {nearest(name, names)}")
        result = cls(**values)
        result.check()
        return result


def describe(kind: type[Configuration]) -> dict[str, dict[str, Any]]:
    """Returns default, help, unit and range of every setting, by name."""
    return {f.name: {"default": f.default, **f.metadata} for f in dataclasses.fields(kind)}


def shown(value: Any) -> str:
    """Returns a value as it is given: true, not True; `-` for one that is as the device has it."""
    return "-" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def texts_of(values: Mapping[str, Any]) -> list[str]:
    """Converts the values of a message to `name=value` texts. Raises ValueError for what is no setting's value."""
    if not values:
        raise ValueError("no setting is given; name one or more, as bias_fo=10")
    for name, value in values.items():
        if not isinstance(name, str) or not isinstance(value, (str, int, float)):
            raise ValueError(f"{name!r:.80} is {value!r:.80}; a setting is a number, true or false, or a text")
        if max(len(name), len(str(value))) > LONGEST_TEXT:
            raise ValueError(f"{name:.80} is {value!r:.80}...; no setting is that long")
    return [f"{name}={value}" for name, value in values.items()]


def parse_settings(kind: type[Configuration], given: Sequence[str]) -> dict[str, Any]:
    """Parses `name=value` texts as the types of the configuration's fields. Raises ValueError that names the
    setting."""
    defaults = {f.name: f for f in dataclasses.fields(kind)}
    result: dict[str, Any] = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"a setting is given as name=value, not '{text}'")
        if name not in defaults:
            result[name] = value  # `of` names the nearest
            continue
        result[name] = _parse_value(name, value, str(defaults[name].type))
    return result


def _parse_value(name: str, value: str, kind: str) -> Any:
    """Parses a text as bool, int, float or str. Raises ValueError that names the setting."""
    try:
        if kind == "bool":
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[value.lower()]
        if kind == "float":
            return float(value)
        return value if kind == "str" else int(value)
    except (ValueError, KeyError):
        words = {"bool": "true or false", "float": "a number"}
        raise ValueError(f"{name} is '{value}', must be {words.get(kind, 'a whole number')}") from None
