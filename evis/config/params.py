"""Declares typed node parameters with units and ranges, and words the errors that name the nearest valid one."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evis.config.removed import instead
from evis.config.secret import SecretError, fetch
from evis.config.suggestions import did_you_mean
from evis.files.regular import other_than_file

EACH = "each"
"""Of a node's parameters, beside those it declares: what environments have for themselves, a mapping for each of them.
Only a graph that is held in Python has it (evis.simulation.each)."""

MOST_SHOWN = 60
"""Characters of a value that an error shows."""


class ParamError(ValueError):
    """Says that a node does not have a parameter or cannot take its value. The text names the node, the key and the
    remedy.
    """


@dataclass(frozen=True)
class Param:
    """Declares one parameter: `type` is int, float, str, bool or list; minimum and maximum are inclusive.

    `default=None` with `optional=True` means "not given". secret: a text that stays out of bags, logs and errors, and
    may be given as `env:NAME` or `file:PATH`, which a list of processes does not show. files: a text that ends so, as
    ".yaml", is the path of a file, which may stand in place of one of the choices; it becomes absolute. words: texts
    that may stand in place of a number.
    """

    type: type
    default: Any
    help: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Any, ...] = ()
    optional: bool = False
    secret: bool = False
    files: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    def convert(self, owner: str, key: str, value: Any) -> Any:
        """Converts a value (from YAML or a command line) to this parameter's type. Raises ParamError."""
        if value is None and self.optional:
            return None
        if self.secret:
            return self._secret(owner, key, value)
        if isinstance(value, str) and value in self.words:
            return value
        value = self._cast(owner, key, value)
        if isinstance(value, float) and not math.isfinite(value):
            raise ParamError(f"{owner}: {key} is {value}; it must be finite")
        if self.files and value not in self.choices and str(value).endswith(self.files):
            return self._file(owner, key, str(value))
        if self.choices and value not in self.choices:
            hint = did_you_mean(str(value), map(str, self.choices))
            allowed = ", ".join(map(str, self.choices)) + (f", or a file {self.files[0]}" if self.files else "")
            raise ParamError(f"{owner}: {key} is '{value!s:.{MOST_SHOWN}}', must be one of {allowed}{hint}")
        unit = f" {self.unit}" if self.unit else ""
        if self.minimum is not None and value < self.minimum:
            raise ParamError(f"{owner}: {key} is {value}{unit}, the least is {in_full(self.minimum)}{unit}")
        if self.maximum is not None and value > self.maximum:
            raise ParamError(f"{owner}: {key} is {value}{unit}, the most is {in_full(self.maximum)}{unit}")
        return value

    def _file(self, owner: str, key: str, value: str) -> str:
        if not os.path.isfile(value):
            what = other_than_file(value)
            told = f"{value} is {what}, and must be a file" if what else f"there is no file {value}"
            raise ParamError(f"{owner}: {key}: {told}")
        return os.path.abspath(value)

    def _secret(self, owner: str, key: str, value: Any) -> str:
        """As `convert`, and no error shows the value."""
        if isinstance(value, (dict, list, tuple)):
            raise ParamError(f"{owner}: {key} must be {_NAMES[str]}")
        try:
            return fetch(str(value))
        except SecretError as error:
            raise ParamError(f"{owner}: {key}: {error}") from None

    def _cast(self, owner: str, key: str, value: Any) -> Any:
        given = _WORDS.get(value) if value is None or isinstance(value, bool) else f"{value!r:.{MOST_SHOWN}}"
        wrong = ParamError(f"{owner}: {key} is {given}, must be {' or '.join([_NAMES[self.type], *self.words])}")
        if self.type is bool:
            if isinstance(value, bool):
                return value
            word = str(value).strip().lower()
            if word in ("true", "yes", "on", "1"):
                return True
            if word in ("false", "no", "off", "0"):
                return False
            raise wrong
        if isinstance(value, bool) and self.type in (int, float):
            raise wrong
        if self.type is list:
            if isinstance(value, str):
                return [v.strip() for v in value.split(",") if v.strip()]
            if isinstance(value, (list, tuple)):
                return list(value)
            raise wrong
        if self.type is str:
            if value is None or isinstance(value, (dict, list)):
                raise wrong
            return _WORDS[value] if isinstance(value, bool) else str(value)
        try:
            if self.type is float:
                return float(value)
            with contextlib.suppress(ValueError):  # a text such as 1e3 is a whole number too
                if isinstance(value, (int, str)):
                    return int(value)
            number = float(value)
            if not number.is_integer():
                raise wrong
            return int(number)
        except (TypeError, ValueError, OverflowError):
            raise wrong from None


_WORDS = {True: "true", False: "false", None: "null"}
"""Values as YAML has them, not as Python does."""
_NAMES = {int: "a whole number", float: "a number", str: "a text", bool: "true or false", list: "a list"}


def resolve(owner: str, declared: Mapping[str, Param], given: Mapping[str, Any]) -> dict[str, Any]:
    """Resolves all parameters of `owner`: the given ones converted and checked, the others at their defaults.

    Raises ParamError naming the owner, the key and the nearest valid key.
    """
    for key in given:
        if key not in declared:
            raise ParamError(f"{owner} has no parameter '{key}'; {instead(key, sorted(declared), 'it has')}")
    return {
        key: param.convert(owner, key, given[key]) if key in given else param.default for key, param in declared.items()
    }


def describe(param: Param) -> str:
    """Describes help, unit, range and default of a parameter, in one line."""
    of_file = f" or a file {param.files[0]}" if param.files else ""
    parts = ["one of " + ", ".join(map(str, param.choices)) + of_file if param.choices else limits(param)]
    parts.append("".join(f"or {word}" for word in param.words))
    parts.append("" if param.default is None else f"default {describe_value(param.default)}")
    return f"{param.help} ({', '.join(p for p in parts if p)})" if any(parts) else param.help


def limits(param: Param) -> str:
    """Describes the range in words, with the unit."""
    if param.minimum is None:
        return f"at most {in_full(param.maximum)} {param.unit}".strip() if param.maximum is not None else param.unit
    upwards = f"to {in_full(param.maximum)}" if param.maximum is not None else "or more"
    return f"{in_full(param.minimum)} {upwards} {param.unit}".strip()


def in_full(value: float) -> str:
    """Formats a number briefly, 2.5 or 1e+09, and with all its digits where six do not tell it: 16777216."""
    brief = f"{value:g}"
    if isinstance(value, int):
        return brief if int(float(brief)) == value else str(value)
    return brief if float(brief) == value else f"{value:.15g}"


def describe_value(value: Any) -> str:
    """Formats a value as a user would write it: 0.2, true, a,b."""
    if isinstance(value, (list, tuple)):
        return ",".join(map(describe_value, value)) or "none"
    if isinstance(value, bool):
        return str(value).lower()
    return in_full(value) if isinstance(value, float) else str(value) or "none"
