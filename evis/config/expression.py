"""Evaluates `${...}` in launch files: arguments, environment variables, and small arithmetic over them.

An expression is parsed by `ast` and walked node by node; what is not in the tables below is refused. There are no
calls, attributes, subscripts or comprehensions, and numbers, texts and lists are bounded, so a hostile file can cost
neither time nor memory, also where one value is made of others many times over.
"""

from __future__ import annotations

import ast
import contextlib
import math
import operator
import os
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from evis.config.document import MAX_DEPTH, MAX_TEXT

MAX_LENGTH = 500
"""Longest expression [characters]."""
MAX_ITEMS = 10_000
"""Most values in the lists that one value of a file gets by `${...}`, those in lists of lists counted too."""
MAX_MADE = 1 << 24
"""Most characters in the texts that a file gets by `${...}`: sixteen times what it may have itself."""
MAX_MADE_ITEMS = 1 << 20
"""Most values in the lists that a file gets by `${...}`."""
MAX_NESTING = 100
"""Most operators within each other, far from the depth at which Python itself gives up: near it nothing else in the
process can run either, so that what is freed by chance meanwhile would be told as an error of its own."""
PARSED = 512
"""Expressions that stay parsed, the last ones; each takes some kB, a hostile one 100."""
_LARGEST = 2**64

_HOLE = re.compile(r"\$\{([^{}]*)\}")
_ENVIRONMENT = re.compile(r"env:([A-Za-z_][A-Za-z0-9_]*)(?::-(.*))?\Z", re.DOTALL)

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_WORDS = {"true": True, "false": False, "null": None, "none": None}


@dataclass
class Room:
    """Holds what the `${...}` of a file may make yet: a short text that is used many times makes a long file of it."""

    characters: int = MAX_MADE
    items: int = MAX_MADE_ITEMS

    def take(self, text: str, characters: int = 0, items: int = 0) -> None:
        """Takes what was made from `text`. Raises ExpressionError naming it where there is no more room."""
        self.characters -= characters
        self.items -= items
        made = f"{MAX_MADE} characters" if self.characters < 0 else f"{MAX_MADE_ITEMS} values" if self.items < 0 else ""
        if made:
            raise ExpressionError(f"'{text:.60}': up to here ${{...}} makes more than {made} of the file")


class ExpressionError(ValueError):
    """Says that a text is not a valid expression; the caller adds file and line."""


def evaluate(text: str, arguments: Mapping[str, Any]) -> Any:
    """Evaluates an expression over `arguments`: + - * / // %, comparisons, and/or/not, in, a if c else b, lists.

    Raises ExpressionError naming what is not allowed or not known.
    """
    expression = _parsed(text)
    try:
        value = _value(expression, arguments, text)
        if not isinstance(expression, ast.Name):
            _left(value, MAX_ITEMS, text)
        return value
    except ZeroDivisionError:
        raise ExpressionError(f"'{text}' divides by zero") from None
    except (TypeError, OverflowError) as error:
        raise ExpressionError(f"'{text}': {str(error).splitlines()[0]}") from None


@lru_cache(PARSED)
def _parsed(text: str) -> ast.expr:
    """Parses an expression; the copies of an entry have the same ones. Raises ExpressionError."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"expression of {len(text)} characters, the limit is {MAX_LENGTH}")
    try:
        with warnings.catch_warnings():
            # Python's advice on how it is written, as for `1if a else 2`, is not for who writes a launch file.
            warnings.simplefilter("ignore", SyntaxWarning)
            warnings.simplefilter("ignore", DeprecationWarning)
            tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"'{text}' is not an expression") from None
    _refuse_deep(tree, text)
    return tree.body


def _refuse_deep(tree: ast.AST, text: str) -> None:
    level = [tree]
    for _ in range(MAX_NESTING):
        level = [part for node in level for part in ast.iter_child_nodes(node)]
        if not level:
            return
    raise ExpressionError(f"'{text:.60}' has more than {MAX_NESTING} operators within each other")


def _value(node: ast.expr, arguments: Mapping[str, Any], text: str) -> Any:
    def of(part: ast.expr) -> Any:
        return _value(part, arguments, text)

    match node:
        case ast.Constant(value=constant) if isinstance(constant, (bool, int, float, str, type(None))):
            return _bounded(constant, text)
        case ast.Name(id=name):
            if name in arguments:
                return arguments[name]
            if name.lower() in _WORDS:
                return _WORDS[name.lower()]
            raise UnknownName(name)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return not of(operand)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_number(of(operand), text)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _number(of(operand), text)
        case ast.BinOp(left=left, op=kind, right=right) if type(kind) in _BINARY:
            a, b = of(left), of(right)
            if not (isinstance(kind, ast.Add) and isinstance(a, str) and isinstance(b, str)):
                a, b = _number(a, text), _number(b, text)
            return _bounded(_BINARY[type(kind)](a, b), text)
        case ast.BoolOp(op=joint, values=parts):
            value = of(parts[0])
            for part in parts[1:]:
                if bool(value) == isinstance(joint, ast.Or):
                    break
                value = of(part)
            return value
        case ast.Compare(left=left, ops=kinds, comparators=rest):
            value = of(left)
            for test, part in zip(kinds, rest):
                other = of(part)
                if not _compared(test, value, other, text):
                    return False
                value = other
            return True
        case ast.IfExp(test=condition, body=yes, orelse=no):
            return of(yes) if of(condition) else of(no)
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [of(item) for item in items]
    raise ExpressionError(
        f"'{text}': {type(node).__name__} is not allowed; use + - * / // %, comparisons, and, or, not"
    )


class UnknownName(ExpressionError):
    """Says that a name is not an argument."""

    def __init__(self, name: str) -> None:
        super().__init__(f"no argument '{name}'")
        self.name = name


def _compared(kind: ast.cmpop, a: Any, b: Any, text: str) -> bool:
    if type(kind) in _COMPARE:
        return bool(_COMPARE[type(kind)](a, b))
    if isinstance(kind, (ast.In, ast.NotIn)):
        if not isinstance(b, (list, str)):
            raise ExpressionError(f"'{text}': `in` needs a list or a text")
        return (a in b) == isinstance(kind, ast.In)
    if isinstance(kind, (ast.Is, ast.IsNot)) and (a is None or b is None):
        return (a is b) == isinstance(kind, ast.Is)
    raise ExpressionError(f"'{text}': this comparison is not allowed here")


def _number(value: Any, text: str) -> Any:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return value
    raise ExpressionError(f"'{text}': {value!r:.60} is not a number")


def _bounded(value: Any, text: str) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        raise ExpressionError(f"'{text}' is not finite")
    if isinstance(value, int) and abs(value) > _LARGEST:
        raise ExpressionError(f"'{text}' is larger than 2^64")
    if isinstance(value, str) and len(value) > MAX_LENGTH:
        raise ExpressionError(f"'{text}' makes a text of more than {MAX_LENGTH} characters")
    return value


def substitute(value: Any, arguments: Mapping[str, Any], room: Room | None = None) -> Any:
    """Replaces every `${...}` in a value, in lists and maps too; a text that is one `${...}` alone takes the type of
    its result.

    room: what may be made yet of the file in which the value stands; None = of this value alone.

    Raises ExpressionError, also for a text or list that becomes too long.
    """
    return _substituted(value, arguments, [MAX_ITEMS], room or Room())


def _substituted(value: Any, arguments: Mapping[str, Any], left: list[int], room: Room) -> Any:
    """left: how many more values the lists that are filled in may have."""
    if isinstance(value, dict):
        return {key: _substituted(item, arguments, left, room) for key, item in value.items()}
    if isinstance(value, list):
        return [_substituted(item, arguments, left, room) for item in value]
    if not isinstance(value, str):
        return value
    whole = _HOLE.fullmatch(value)
    if whole:
        filled = _fill(whole[1], arguments)
        if isinstance(filled, list):
            before, left[0] = left[0], _left(filled, left[0], value)
            room.take(value, items=before - left[0])
        return filled
    if "${" in _HOLE.sub("", value):
        raise ExpressionError(f"'{value:.60}' has a ${{ without its }}")
    filled = _with_holes_filled(value, arguments)
    if filled is not value:
        room.take(value, characters=len(filled))
    return filled


def _with_holes_filled(text: str, arguments: Mapping[str, Any]) -> str:
    """The text itself where it has no hole."""
    pieces, length, at = [], 0, 0
    for hole in _HOLE.finditer(text):
        pieces += [text[at : hole.start()], text_of(_fill(hole[1], arguments))]
        length, at = length + len(pieces[-2]) + len(pieces[-1]), hole.end()
        if length > MAX_TEXT:
            raise ExpressionError(f"'{text:.60}' becomes a text of more than {MAX_TEXT} characters")
    return "".join([*pieces, text[at:]]) if pieces else text


def _left(value: Any, most: int, text: str, depth: int = MAX_DEPTH) -> int:
    """`most` less the number of values in a list. Lists share what they are made of, so they grow at no cost.

    Raises ExpressionError naming `text` where there are more, or lists within each other deeper than `depth`.
    """
    if most < 1 or not depth:
        raise ExpressionError(f"'{text:.60}' makes more than {MAX_ITEMS} values or {MAX_DEPTH} levels of lists")
    most -= 1
    for item in value if isinstance(value, list) else ():
        most = _left(item, most, text, depth - 1)
    return most


def names_in(value: Any) -> set[str]:
    """Collects the names that the `${...}` of a value of a launch file ask for, lists and maps gone through."""
    if isinstance(value, dict):
        return set().union(*map(names_in, value.values()))
    if isinstance(value, list):
        return set().union(*map(names_in, value))
    found: set[str] = set()
    for inside in _HOLE.findall(value) if isinstance(value, str) else ():
        if not _ENVIRONMENT.match(inside.strip()):
            with contextlib.suppress(ExpressionError):  # who evaluates it says what is wrong with it
                found |= {node.id for node in ast.walk(_parsed(inside)) if isinstance(node, ast.Name)}
    return found


def text_of(value: Any) -> str:
    """Formats a value as it stands inside a text: true, false, empty for null, lists with commas."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return ",".join(text_of(item) for item in value)
    return str(value)


def _fill(inside: str, arguments: Mapping[str, Any]) -> Any:
    variable = _ENVIRONMENT.match(inside.strip())
    if variable:
        found = os.environ.get(variable[1], variable[2])
        if found is None:
            name = variable[1]
            raise ExpressionError(f"environment variable {name} is not set; ${{env:{name}:-DEFAULT}} gives a default")
        return found
    return evaluate(inside, arguments)
