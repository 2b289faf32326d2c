"""Describes the faults that an emulated device shows on request."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from evis.config.suggestions import nearest


def fault(default: Any, help: str) -> Any:
    """Makes a field of `Faults` with its help text."""

    return field(default=default, metadata={"help": help})


@dataclass
class Faults:
    """Sets the faults of an emulated device, all off by default.

    Counts are of bulk reads or of bytes on the data endpoint; nothing is random.
    """

    absent: bool = fault(False, "the device is not on the bus")
    busy: bool = fault(False, "another program holds its interface")
    no_permission: bool = fault(False, "the system does not let it be opened")
    unknown_firmware: bool = fault(False, "it states a firmware that no driver knows")
    unknown_chip: bool = fault(False, "its chip is another one than it says")
    control_timeout: bool = fault(False, "it does not answer requests")
    short: int = fault(0, "a read gives at most so many bytes")
    timeout_every: int = fault(0, "every nth read times out")
    stall_every: int = fault(0, "every nth read stalls the endpoint")
    lose_every: int = fault(0, "every nth read loses one USB packet of 512 bytes before it")
    garbage_every: int = fault(0, "before every nth read, 64 bytes of no meaning arrive")
    unplug_after: int = fault(0, "it is unplugged after so many bytes")
    replug: bool = fault(False, "and plugged in again afterwards")

    @classmethod
    def of(cls, text: str) -> Faults:
        """Parses faults from a text such as `stall_every=7,short=100,busy`. Raises ValueError with the nearest name."""
        known = {f.name: f.type for f in fields(cls)}
        result = cls()
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, given, value = part.partition("=")
            if name not in known:
                raise ValueError(f"an emulated camera has no fault '{name}'; {nearest(name, known)}")
            if known[name] == "bool":
                if given and value not in ("true", "false"):
                    raise ValueError(f"the fault {name} is true or false, not '{value}'")
                setattr(result, name, value != "false")
            elif not value.isdecimal():
                raise ValueError(f"the fault {name} needs a count, as {name}=100, not '{value}'")
            else:
                setattr(result, name, int(value))
        return result
