"""Docstrings begin with a sentence that says what their module, class or function does: "Computes ...".

Everywhere those of what is public; in the rooms of WHOLE those of what is private too.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from import_graph import ROOT

VERB = re.compile(r"[A-Z][a-z]+s\b")
"""A verb in the third person, as far as its ending tells: plural nouns pass too, which a reviewer has to see."""

NOUNS = frozenset(
    "Actuators Arrays Bytes Columns Constraints Engines Environments Events Instants Keyframes Messages Pixels Poses "
    "Products Radius Splines Stiffness Threads Triangles".split()
)
"""Some that such sentences began with, and that are no verbs."""

WHOLE = [
    "evis/bag",
    "evis/bus",
    "evis/env",
    "evis/events",
    "evis/gpu",
    "evis/launch",
    "evis/recordings",
    "evis/remote",
    "evis/runtime",
    "evis/shares",
    "evis/simulation",
    "evis/supervisor",
    "evis/web",
    "nodes/camera",
    "nodes/event_sensor",
    "nodes/interpolator",
    "nodes/labeler",
    "nodes/physics",
    "nodes/recorder",
    "nodes/renderer",
    "nodes/replayer",
    "nodes/visualizer",
]

Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def openings(node: ast.Module | Definition, name: str, private: bool = False) -> Iterator[tuple[str, str]]:
    """Yields the names and docstrings of a module or class, and of what is public, or anything at all, in it."""
    if docstring := ast.get_docstring(node):
        yield name, docstring
    if isinstance(node, ast.Module | ast.ClassDef):
        for inner in node.body:
            if isinstance(inner, Definition) and (private or not inner.name.startswith("_")):
                yield from openings(inner, f"{name}.{inner.name}", private)


def begins_with_a_verb(docstring: str) -> bool:
    first = VERB.match(docstring)
    return first is not None and first[0] not in NOUNS


@pytest.mark.parametrize("package", ["msgs", "evis", "nodes", "bench", "examples"])
def test_docstrings_begin_with_a_verb(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        for name, docstring in openings(ast.parse(path.read_text()), path.relative_to(ROOT).as_posix()):
            assert begins_with_a_verb(docstring), f"{name}: {docstring.splitlines()[0]}"


@pytest.mark.parametrize("room", WHOLE)
def test_private_docstrings_begin_with_a_verb(room: str) -> None:
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    for path in files:
        for name, docstring in openings(ast.parse(path.read_text()), path.relative_to(ROOT).as_posix(), private=True):
            assert begins_with_a_verb(docstring), f"{name}: {docstring.splitlines()[0]}"
