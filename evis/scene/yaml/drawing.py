"""Reads draws of a scene file: `{from: a, to: b}`, `{choose: [...]}` or `{normal: {mean: m, sigma: s}}` in a value's
place.

    {from: a, to: b}             evenly between; `log: true`: evenly in the logarithm
    {choose: [x, y, z]}          one of them; what stands there twice is drawn twice as often
    {normal: {mean, sigma}}      a normal distribution, cut off at `min` and `max` where given

Ends, mean and sigma are written as the value itself would be, `5 deg` or `[0, 0, 1]`; of lists every element is drawn
by itself. Where a whole number is wanted, one of those between the ends is drawn, the ends among them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from evis.config.document import Row, Table
from evis.config.expression import ExpressionError, substitute
from evis.scene.draws import Choice, Draws, Law, Normal, Uniform
from evis.scene.errors import SceneError

KINDS = ("from", "to", "choose", "normal")
"""Keys by which a map is a draw."""
_ANGLE = re.compile(r"\s*(.+?)\s*(deg|rad)\s*\Z")


class Values(Protocol):
    """Reads the map of a draw, as `reader.Fields` does."""

    table: Table
    draws: Draws | None
    address: str

    def has(self, key: str) -> bool: ...
    def plain(self, key: str) -> Any: ...
    def flag(self, key: str, default: bool) -> bool: ...
    def number_of(self, key: str, value: Any) -> float: ...
    def section(self, key: str, what: str) -> Values | None: ...
    def error(self, key: str | None, text: str) -> SceneError: ...
    def done(self) -> None: ...


def is_draw(value: Any) -> bool:
    """Tells whether a value of the file is a draw."""
    return isinstance(value, Table) and any(key in value for key in KINDS)


def how_to_draw(value: Any) -> str:
    """Says how a draw is written, to stand behind an error about a map in a value's place; nothing for other values.

    Recipes of data sets draw by `choices`, which here is `choose`: who mixes them up is not to look for it.
    """
    law = "; a draw is {from: a, to: b}, {choose: [a, b]} or {normal: {mean: m, sigma: s}}"
    return law if isinstance(value, Table) else ""


def has_draws(value: Any) -> bool:
    """Tells whether a list holds draws, at any depth, and no other maps."""
    return isinstance(value, Row) and any(map(is_draw, _leaves(value))) and not any(map(_is_map, _leaves(value)))


def places_of(rows: Sequence[Any], within: str) -> list[str]:
    """Names the entries of a list: by their own `name`, else by number, so that a new one shifts no draws of named
    ones."""
    names = [str(row.get("name", "")) if isinstance(row, dict) else "" for row in rows]
    own = [name and "${" not in name and names.count(name) == 1 for name in names]
    return [f"{within}.{name}" if mine else f"{within}[{i}]" for i, (name, mine) in enumerate(zip(names, own))]


def drawn_within(value: Any, arguments: Mapping[str, Any], place: str = "") -> Iterator[str]:
    """Finds the places of a part of the file at which something is left to chance, without drawing.

    Copies count as the one entry that they are written as. arguments: with None for those that are drawn themselves.
    """
    if is_draw(value):
        if not _settled(value, arguments):
            yield place
    elif isinstance(value, Table):
        for key, inner in value.items():
            if key == "folder":
                if not _settled_folder(inner, arguments):
                    yield f"{place}.{key}"
            elif not (key == "random" and place.endswith(".copies")):
                yield from drawn_within(inner, arguments, f"{place}.{key}" if place else key)
            elif isinstance(inner, Table):
                yield from drawn_within(inner.get("seed"), arguments, f"{place}.random.seed")
    elif isinstance(value, Row):
        for name, inner in zip(places_of(value, place), value):
            yield from drawn_within(inner, arguments, name)


def _settled(value: Table, arguments: Mapping[str, Any]) -> bool:
    """Whether a draw has one outcome. One that uses variables of copies counts as random."""
    try:
        filled = substitute(value, arguments)
    except ExpressionError:
        return False
    if "choose" in filled:
        choices = filled["choose"]
        return isinstance(choices, list) and all(choice == choices[0] for choice in choices)
    normal = filled.get("normal")
    if isinstance(normal, dict):
        return bool(normal.get("sigma") == 0)
    return bool(_plain(filled.get("from")) == _plain(filled.get("to")))


def _settled_folder(name: Any, arguments: Mapping[str, Any]) -> bool:
    """Whether the `folder:` of a texture or shape names none, so that nothing is drawn from it."""
    try:
        return not substitute(name, arguments)
    except ExpressionError:
        return False


def split_unit(value: Any) -> tuple[Any, str]:
    """Splits a text that ends in `deg` or `rad` into its number, still a text, and the unit; '' is that of all else."""
    angle = _ANGLE.match(value) if isinstance(value, str) else None
    return (angle[1], angle[2]) if angle else (value, "")


def _plain(value: Any) -> Any:
    """Numbers of a value as far as they can be told, without their units where 0."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    text, unit = split_unit(value)
    try:
        number = float(text)
    except (TypeError, ValueError):
        return value
    return (number, unit) if unit and number else number


def draw(fields: Values, whole: bool = False) -> Any:
    """Draws the value that `fields`, the map of a draw, stands for; its place is that of the map. Raises SceneError."""
    ends = _read(fields, whole)
    if isinstance(ends, tuple):  # values to choose from
        assert fields.draws is not None
        return fields.draws.value(fields.address, Choice(ends))
    return _each(fields, ends, fields.address, whole)


def law_of(fields: Values) -> Law:
    """Reads the law of a single number or choice, without drawing. Raises SceneError."""
    ends = _read(fields, False)
    return Choice(ends) if isinstance(ends, tuple) else _law(fields, ends, False)[0]


def _read(fields: Values, whole: bool) -> tuple[Any, ...] | dict[str, Any]:
    """The values to choose from, or the numbers or lists that `from`, `to` and so on are."""
    kinds = [key for key in ("choose", "normal", "from") if fields.has(key)]
    if fields.has("to") and "from" not in kinds:
        raise fields.error("to", "stands without from")
    if len(kinds) > 1:
        raise fields.error(kinds[1], f"and {kinds[0]} are given; leave one out")
    if kinds == ["choose"]:
        values = fields.plain("choose")
        if not isinstance(values, list) or not values:
            raise fields.error("choose", "must be a list of at least one value")
        if any(map(_is_map, _leaves(values))):
            raise fields.error("choose", "has a map in it; it must be a list of numbers, texts or lists of them")
        fields.done()
        return tuple(values)
    if kinds == ["from"]:
        ends = {key: fields.plain(key) for key in ("from", "to")} | {"log": fields.flag("log", False)}
        if ends["log"] and whole:
            raise fields.error("log", "is not for whole numbers")
    else:
        part = fields.section("normal", "normal")
        assert part is not None
        ends = {key: part.plain(key) for key in ("mean", "sigma")}
        ends |= {key: part.plain(key) for key in ("min", "max") if part.has(key)}
        part.done()
    fields.done()
    return ends


def _each(fields: Values, ends: Mapping[str, Any], place: str, whole: bool) -> Any:
    """The value, or the list of them where the ends are lists."""
    first = "from" if "from" in ends else "mean"
    if not isinstance(ends[first], list):
        return _one(fields, ends, place, whole)
    count = len(ends[first])
    for key, value in ends.items():
        shared = key in ("log", "sigma", "min", "max") and not isinstance(value, list)
        if not shared and (not isinstance(value, list) or len(value) != count):
            raise fields.error(key, f"is {value!r:.60}; it must be a list of {count} as {first} is")
    parts = [{k: v[i] if isinstance(v, list) else v for k, v in ends.items()} for i in range(count)]
    return [_each(fields, part, f"{place}[{i}]", whole) for i, part in enumerate(parts)]


def _one(fields: Values, ends: Mapping[str, Any], place: str, whole: bool) -> Any:
    law, unit = _law(fields, ends, whole)
    if law.fixed():
        value = ends["from"] if "from" in ends else ends["mean"]
        return law.value(0.5) if whole or not isinstance(value, str) else value
    assert fields.draws is not None
    drawn = fields.draws.value(place, law, unit)
    return f"{drawn!r} {unit}" if unit else drawn


def _law(fields: Values, ends: Mapping[str, Any], whole: bool) -> tuple[Law, str]:
    """The law of one number, and its unit. Raises SceneError."""
    numbers, unit = _quantities(fields, {k: v for k, v in ends.items() if k != "log"})
    if "from" in numbers:
        low, high = numbers["from"], numbers["to"]
        if low > high:
            raise fields.error("from", f"is {low:g}, more than `to`, which is {high:g}")
        if ends["log"] and low <= 0:
            raise fields.error("from", f"is {low:g}; with `log` it must be more than 0")
        if whole:
            low, high = float(math.ceil(low)), float(math.floor(high))
            if low > high:
                raise fields.error("from", "and to have no whole number between them, and one is wanted")
        return Uniform(low, high, ends["log"], whole), unit
    low, high = numbers.get("min", -math.inf), numbers.get("max", math.inf)
    if numbers["sigma"] < 0:
        raise fields.error("normal", f"has a sigma of {numbers['sigma']:g}; the least is 0")
    outside = not low <= numbers["mean"] <= high
    if low > high or (numbers["sigma"] and low == high) or (not numbers["sigma"] and outside):
        raise fields.error("normal", f"leaves nothing between min and max, {low:g} and {high:g}")
    if whole:
        raise fields.error("normal", "gives no whole numbers, and one is wanted; take from and to, or choose")
    return Normal(numbers["mean"], numbers["sigma"], low, high), unit


def _quantities(fields: Values, ends: Mapping[str, Any]) -> tuple[dict[str, float], str]:
    """Numbers in one unit, that in which all are written, else radians; 0 has any."""
    read = {key: _quantity(fields, key, value) for key, value in ends.items()}
    units = {unit for number, unit in read.values() if number or unit}
    if len(units) < 2:
        return {key: number for key, (number, _) in read.items()}, next(iter(units), "")
    return {k: math.radians(n) if unit == "deg" else n for k, (n, unit) in read.items()}, "rad"


def _quantity(fields: Values, key: str, value: Any) -> tuple[float, str]:
    number, unit = split_unit(value)
    return fields.number_of(key if key in fields.table else "normal", number), unit


def _leaves(value: Any) -> list[Any]:
    """What stands in a list, those within it gone through."""
    return [leaf for item in value for leaf in (_leaves(item) if isinstance(item, list) else [item])]


def _is_map(value: Any) -> bool:
    return isinstance(value, dict) and not is_draw(value)
