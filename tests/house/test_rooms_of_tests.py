"""The rooms of the tests: they can be overseen, each module goes by one name, and what names one names it rightly."""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
MOST_FILES = 20
"""Largest room, as of the code."""


def test_rooms_can_be_overseen() -> None:
    rooms = Counter(path.parent.relative_to(ROOT).as_posix() for path in TESTS)
    assert len(rooms) > 50 and [room for room, files in rooms.items() if files > MOST_FILES] == []


def test_no_two_modules_have_one_name() -> None:
    """Rooms are no packages, so that pytest and Python know a module by its name alone. Of conftest.py pytest takes
    care."""
    names = Counter(path.name for path in TESTS if path.name != "conftest.py")
    assert len(names) > 400 and [name for name, count in names.items() if count > 1] == []


def test_a_module_is_imported_by_one_name() -> None:
    """By two it would be loaded twice, and `tests` may be somebody else's."""
    named = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in TESTS
        for node in ast.walk(ast.parse(path.read_text()))
        if (isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "tests")
        or (isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "tests" for alias in node.names))
    ]
    assert named == []


def test_no_module_imports_one_of_tests() -> None:
    """What several share is a module beside them, or a fixture in conftest.py: pytest would collect an imported test
    in each module again, and an imported fixture has to be named to stay."""
    named = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in TESTS
        for node in ast.walk(ast.parse(path.read_text()))
        if (isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[-1].startswith("test_"))
        or (isinstance(node, ast.Import) and any(alias.name.split(".")[-1].startswith("test_") for alias in node.names))
    ]
    assert named == []


@pytest.mark.parametrize("variable", ["COMPUTE", "WAIT"])
def test_what_the_makefile_runs_is_there(variable: str) -> None:
    """pytest stops at a path that is not there; one that is only left out by --ignore is passed over in silence."""
    shown = f"show:; @echo $({variable})"
    done = subprocess.run(
        ["make", "-s", "-f", "Makefile", "--eval", shown, "show"], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    paths = done.stdout.split()
    assert done.returncode == 0 and len(paths) > 5, done.stderr
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_tests_that_pages_run_are_there() -> None:
    """As `pytest tests/bus`, with whatever options."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    named = [
        (page.name, path) for page in pages for path in re.findall(r"pytest [^`\n]*?(tests/[\w./]+)", page.read_text())
    ]
    assert len(named) > 5 and [(page, path) for page, path in named if not (ROOT / path).exists()] == []
