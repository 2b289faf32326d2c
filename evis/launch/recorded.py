"""Implements `recorded:` in a launch file: arguments that are not given are those of the run that made a bag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.document import LaunchError, Table, parse_value
from evis.config.expression import ExpressionError, substitute
from evis.config.secret import HIDDEN
from evis.config.suggestions import nearest

KEYS = ("bag", "except")
TABLE, PREFIX = "evis", "arg."
"""Where the recorder keeps the arguments of a run in the bag's metadata."""


def recorded(entry: Table, values: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Returns `given`, and what the bag tells about the other arguments but those under `except:`.

    Raises LaunchError for a bag that cannot be read.
    """
    entry.check_keys(KEYS, "`recorded`")
    try:
        bag = substitute(entry.get("bag", ""), values)
    except ExpressionError as error:
        raise LaunchError(f"{entry.where('bag')}: {error}") from None
    stored = _stored(str(bag), entry.where("bag"))
    own = [str(name) for name in entry.get("except") or []]
    for name in own:
        if name not in values:
            raise LaunchError(f"{entry.where('except')}: there is no argument '{name}'; {nearest(name, values)}")
    told = {name: stored[PREFIX + name] for name in values if PREFIX + name in stored and name not in own}
    found = {name: _value(text, f"{bag}, argument {name}") for name, text in told.items()}
    return {**{name: value for name, value in found.items() if value is not None}, **given}


def _value(text: str, name: str) -> Any:
    """Reads a value that was written as Python's text: True, 0.2, ['cam0'], None. Raises LaunchError naming `name`.

    A secret was not written.
    """
    return None if text.strip() in ("", "None") or HIDDEN in text else parse_value(text, name)


def _stored(bag: str, where: str) -> Mapping[str, str]:
    from evis.bag.reader import BagReader

    try:
        with BagReader(bag) as reader:
            return reader.metadata.get(TABLE, {})
    except (ValueError, OSError) as error:
        raise LaunchError(f"{where}: {error}") from None
