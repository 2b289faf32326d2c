"""The plan of the house: no circles of imports, rooms that can be overseen, and one spelling of a name.

A circle counts wherever the import stands: in a function it hides the circle from Python alone, and under
TYPE_CHECKING from the interpreter alone; a reader has to go round in both.
"""

from __future__ import annotations

import ast
import re
import sys
import warnings
from collections import Counter
from pathlib import Path

import pytest
from import_graph import PACKAGES, ROOT, circles, import_graph, package_graph, sources

MOST_FILES = 20
"""Largest room, not counting `__init__.py`."""
MANY_FILES = 15
"""Rooms with more are warned of."""

TOLD = [
    "evis/bag",
    "evis/bus",
    "evis/events",
    "evis/runtime",
    "evis/supervisor",
    "nodes/camera",
    "nodes/event_sensor",
    "nodes/interpolator",
    "nodes/labeler",
    "nodes/recorder",
    "nodes/renderer",
    "nodes/replayer",
]
"""Deep rooms whose packages tell the way of the data in them."""

LAZY = {"importlib.metadata", "difflib"}
"""Parts of the standard library that `evis --help` does without: 20 ms and 2 ms."""
EARLY = "evis/console/interrupt.py"
"""Loaded before anything else, so that Ctrl-C while the rest is imported is handled."""


def test_no_circles_of_files() -> None:
    assert circles(import_graph()) == []


def test_no_circles_of_packages() -> None:
    """Rooms at the top of `evis` and nodes."""
    assert circles(package_graph(import_graph())) == []


@pytest.mark.parametrize(
    "text",
    [
        "import evis.b",
        "from evis import b",
        "def f():\n    from evis.b import g",
        "if TYPE_CHECKING:\n    import evis.b",
    ],
)
def test_a_circle_is_found(text: str, tmp_path: Path) -> None:
    """However the import is written."""
    (tmp_path / "evis").mkdir()
    (tmp_path / "evis" / "a.py").write_text(text)
    (tmp_path / "evis" / "b.py").write_text("from evis.a import f")
    assert circles(import_graph(tmp_path)) == [{"evis.a", "evis.b"}]


def test_rooms_can_be_overseen() -> None:
    """At most MOST_FILES in a folder."""
    rooms = Counter(p.parent.relative_to(ROOT).as_posix() for p in sources().values() if p.name != "__init__.py")
    assert [room for room, files in rooms.items() if files > MOST_FILES] == []
    for room, files in rooms.items():
        if files > MANY_FILES:
            warnings.warn(f"{room} has {files} files", stacklevel=1)


def test_one_spelling_of_kernels_and_no_utils() -> None:
    """`kernels.py` or `<what>_kernels.py` for Warp's functions; a file is called by what is in it."""
    for path in sources().values():
        if "kernel" in path.name:
            assert path.name == "kernels.py" or path.name.endswith("_kernels.py"), path
        assert not {"util", "utils", "helpers", "misc", "common"} & set(path.stem.split("_")), path


@pytest.mark.parametrize("house", TOLD)
def test_a_room_tells_what_is_in_it(house: str) -> None:
    """The docstring of each package in these deep trees names its files and rooms, all of them and no others."""
    for package in sorted((ROOT / house).rglob("__init__.py")):
        told = set(re.findall(r"`([a-z_0-9]+(?:\.py|\.h|/))`", ast.get_docstring(ast.parse(package.read_text())) or ""))
        there = {path.name for path in package.parent.glob("*.py")} - {package.name}
        there |= {path.name for path in package.parent.glob("*.h")}
        there |= {f"{path.parent.name}/" for path in package.parent.glob("*/__init__.py")}
        assert told == there, package


def standard_imports_in_functions(path: Path) -> set[str]:
    """Names what a file imports of the standard library inside functions."""
    found = set()
    for function in ast.walk(ast.parse(path.read_text())):
        if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
            for node in ast.walk(function):
                if isinstance(node, ast.Import):
                    found |= {alias.name for alias in node.names}
                elif isinstance(node, ast.ImportFrom):
                    found.add(str(node.module))
    return {name for name in found if name.split(".")[0] in sys.stdlib_module_names}


def test_the_standard_library_is_imported_at_the_top() -> None:
    """It costs next to nothing there."""
    found = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in sources().values()
        if path != ROOT / EARLY
        for name in standard_imports_in_functions(path) - LAZY
    }
    assert sorted(found) == []


def test_there_is_a_house() -> None:
    """So that these tests look at something."""
    assert {path.relative_to(ROOT).parts[0] for path in sources().values()} == set(PACKAGES) and len(sources()) > 300
