"""Expands `copies:` of a scene file: one entry that stands for many."""

from __future__ import annotations

import itertools
import keyword
import math
import zlib
from typing import Any

import numpy as np

from evis.scene.yaml.drawing import is_draw, law_of
from evis.scene.yaml.reader import Fields

MAX_COPIES = 100_000
"""Most entries that the `copies` of a scene make."""
MAX_VALUES = 1_000_000
"""Most values that one `copies` works out: its copies times its variables."""


def copies(fields: Fields) -> list[tuple[str, Fields]]:
    """Lists what an entry stands for: (ending of the name, fields with the variables of `copies` filled in).

        copies:
          over:   {row: 4, side: [-1, 1]}         every combination; a number n counts 0 ... n - 1; the last is fastest
          random: {seed: 7, turn: {from: 0, to: 0.3}, paint: {choose: [red, blue]}}     drawn anew for every copy,
                                                                         alike in every world unless seed is drawn
          let:    {x: "${row * 2.5}"}             worked out in order
          if:     "${row > 0}"                    leaves out the others

    Names end in the positions within `over`: shelf_0_1. A draw depends on the seed, its name and the copy alone. An
    entry without `copies` stands for itself. Raises SceneError.
    """
    section = fields.section("copies", "copies")
    if section is None:
        return [("", fields)]
    over = section.section("over", "over")
    if over is None or not over.table:
        raise section.error(None, "needs 'over', such as {i: 10}")
    values = {name: _values(over, name) for name in over.table}
    count = math.prod(len(v) for v in values.values())
    if count > MAX_COPIES:
        raise section.error("over", f"makes {count} copies; the most is {MAX_COPIES}")
    let, random = section.section("let", "let"), section.section("random", "random")
    variables = sum(len(part.table) for part in (over, let, random) if part)
    if count * variables > MAX_VALUES:
        raise section.error(
            None, f"makes {count} copies of {variables} variables each; the most is {MAX_VALUES} in all"
        )
    draws = _draws(random, count)
    result = []
    for number, places in enumerate(itertools.product(*(range(len(v)) for v in values.values()))):
        own = {name: values[name][place] for name, place in zip(values, places)}
        own |= {name: drawn[number] for name, drawn in draws.items()}
        ending = "".join(f"_{place}" for place in places)
        copy = fields.with_arguments({**fields.arguments, **own}, fields.address + ending)
        copy.has("copies")
        for name in let.table if let else ():
            assert let is not None
            _check_name(let, name)
            value = let.with_arguments(copy.arguments, copy.within("copies.let")).raw(name)
            copy.arguments = {**copy.arguments, name: value}
        kept = section.with_arguments(copy.arguments, copy.within("copies"))
        if kept.flag("if", True):
            result.append((ending, copy))
    section.has("if")
    section.done()
    return result


def _values(over: Fields, name: str) -> list[Any]:
    _check_name(over, name)
    value = over.raw(name, whole=True)
    if isinstance(value, list):
        return list(over.plain(name))
    return list(range(over.whole(name, maximum=MAX_COPIES)))


def _draws(random: Fields | None, count: int) -> dict[str, list[Any]]:
    """Random values per name, one for each copy."""
    if random is None:
        return {}
    seed = random.whole("seed", 0, maximum=(1 << 32) - 1)
    result: dict[str, list[Any]] = {}
    for name in random.table:
        if name == "seed":
            continue
        _check_name(random, name)
        entry = random.table[name]
        random.has(name)
        if not is_draw(entry):
            raise random.error(name, f"is {entry!r:.60}; it must be a draw, such as {{from: 0, to: 1}}")
        law = law_of(Fields(entry, f"{random.what}, {name}", random.arguments))
        uniform = np.random.Generator(np.random.Philox(key=[seed, zlib.crc32(name.encode())])).random(count)
        result[name] = [law.value(u) for u in uniform.tolist()]
    return result


def _check_name(fields: Fields, name: str) -> None:
    if not name.isidentifier() or keyword.iskeyword(name):
        raise fields.error(name, "is no name for a variable; use letters, digits and _")
    if name in fields.arguments:
        raise fields.error(name, "is the name of an argument already; choose another")


class Copies:
    """Makes what the entries of one scene stand for; copies within copies are counted together."""

    def __init__(self) -> None:
        self._made = 0

    def of(self, entry: Fields) -> list[tuple[str, Fields]]:
        """Lists what an entry stands for, as `copies` does. Raises SceneError for more than MAX_COPIES in the scene."""
        made = copies(entry)
        self._made += len(made)
        if self._made > MAX_COPIES:
            raise entry.error(
                "copies", f"makes more than {MAX_COPIES} bodies, shapes, lights and cameras in this scene"
            )
        return made
