"""What a camera driver is: open, info, configure, start, read, stop, close.

One file per camera family. Decoding is the business of `evis.events`, one file per codec.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, ClassVar

import numpy as np

from evis.config.suggestions import nearest
from evis.events.container import Events


@dataclass(frozen=True)
class DeviceInfo:
    """Who a camera is. `clock` names the domain of its times in message headers."""

    name: str
    serial: str
    sensor: str
    width: int
    height: int
    encoding: str
    clock: str
    details: dict[str, Any] = field(default_factory=dict)


def setting(default: Any, help: str, unit: str = "", minimum: float | None = None, maximum: float | None = None) -> Any:
    """A field of a configuration: its default, what it is, its unit and its inclusive range."""
    facts = {"help": help, "unit": unit, "minimum": minimum, "maximum": maximum}
    return field(default=default, metadata=facts)


@dataclass
class Configuration:
    """Base of the settings of a camera family: a dataclass of `setting` fields."""

    def check(self) -> None:
        """Raise ValueError that names the setting, its range and its unit."""
        for f in dataclasses.fields(self):
            value, unit = getattr(self, f.name), f.metadata["unit"]
            low, high = f.metadata["minimum"], f.metadata["maximum"]
            if value is None:  # not given: as the device has it
                continue
            if isinstance(value, (int, float)) and not math.isfinite(value):
                raise ValueError(f"{f.name} is {value}; it must be finite")
            if (low is not None and value < low) or (high is not None and value > high):
                span = f"at least {low:g}" if high is None else f"{low:g} to {high:g}"
                raise ValueError(f"{f.name} is {value:g} {unit}; it must be {span} {unit}".replace(" ;", ";").rstrip())

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Any:
        """From names and values, checked. Raises ValueError with the nearest name for an unknown one."""
        names = [f.name for f in dataclasses.fields(cls)]
        for name in values:
            if name not in names:
                raise ValueError(f"no setting '{name}'; {nearest(name, names)}")
        result = cls(**values)
        result.check()
        return result


def describe(kind: type[Configuration]) -> dict[str, dict[str, Any]]:
    """Default, help, unit and range of every setting, by name."""
    return {f.name: {"default": f.default, **f.metadata} for f in dataclasses.fields(kind)}


def parse_settings(kind: type[Configuration], given: Sequence[str]) -> dict[str, Any]:
    """`name=value` texts as the types of the configuration's fields. Raises ValueError that names the setting."""
    defaults = {f.name: f for f in dataclasses.fields(kind)}
    result: dict[str, Any] = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"a setting is given as name=value, not '{text}'")
        if name not in defaults:
            result[name] = value  # `of` names the nearest
            continue
        result[name] = _typed(name, value, str(defaults[name].type))
    return result


def _typed(name: str, value: str, kind: str) -> Any:
    """A text as bool, int, float or str."""
    try:
        if kind == "bool":
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[value.lower()]
        if kind == "float":
            return float(value)
        return value if kind == "str" else int(value)
    except (ValueError, KeyError):
        words = {"bool": "true or false", "float": "a number"}
        raise ValueError(f"{name} is '{value}', must be {words.get(kind, 'a whole number')}") from None


@dataclass
class Reading:
    """The events of the interval (t0_ns, stamp_ns] on the device's clock, in the order and with the times it gave.

    raw: the wire bytes (uint8) of the interval if asked for. lost: events or bytes known to be missing before it.
    late_ns: how much later than its due time it is handed over (files at a set pace only).
    """

    events: Events
    t0_ns: int
    stamp_ns: int
    raw: np.ndarray | None = None
    lost: int = 0
    late_ns: int = 0


class Driver(abc.ABC):
    """A camera. Use: `with Driver(...) as d: d.configure(...); d.start(); d.read(0.1)`.

    Entering opens, leaving stops and closes, also after an error. Failures are OSError or ValueError with one line.
    """

    SETTINGS: ClassVar[type[Configuration]]
    t0_ns: int = 0
    """Where the stream begins on the device's clock; known after start where the source knows it."""
    episode: int = 0
    """Goes up each time the device's clock starts anew (after it was unplugged)."""

    @abc.abstractmethod
    def open(self) -> None:
        """Get hold of the device and ask it who it is."""

    @abc.abstractmethod
    def info(self) -> DeviceInfo:
        """Who it is; only while open."""

    def settings_type(self) -> type[Configuration]:
        """The configuration that this camera takes; only while open."""
        return self.SETTINGS

    @abc.abstractmethod
    def configure(self, configuration: Configuration) -> None:
        """Apply settings (of type SETTINGS). Raises ValueError for one out of range."""

    @abc.abstractmethod
    def start(self) -> None:
        """Let the stream begin."""

    @abc.abstractmethod
    def read(self, timeout_s: float) -> Reading | None:
        """The next interval; None when it is not there after timeout_s, and at the end (`ended`)."""

    @property
    @abc.abstractmethod
    def ended(self) -> bool:
        """True when nothing more will come: the end of a file; never for a device that is there."""

    def counters(self) -> dict[str, int]:
        """What was dropped, skipped or out of order so far, by name; only what is not 0."""
        return {}

    @abc.abstractmethod
    def stop(self) -> None:
        """End the stream; does nothing when it has not begun."""

    @abc.abstractmethod
    def close(self) -> None:
        """Give the device back; does nothing when it is not open."""

    def __enter__(self) -> Driver:
        self.open()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self.stop()
        finally:
            self.close()
