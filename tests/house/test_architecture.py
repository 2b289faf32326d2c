"""What the pages say of the code's rooms: files and folders that they name exist, and the picture shows the rooms."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
TOPS = ("msgs", "evis", "nodes", "bench", "launch", "scenes", "docs", "tests")


def _paths(page: Path) -> set[str]:
    """Paths from the top of the checkout, in back quotes."""
    found = re.findall(r"`((?:" + "|".join(TOPS) + r")/[\w./-]*)`", page.read_text())
    # Other things are named with a slash too; a room without one is looked at where rooms are the subject.
    return {path.rstrip("/") for path in found if page.name == "architecture.md" or re.search(r"/$|\.\w+$", path)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_path_on_a_page_exists(page: Path) -> None:
    assert [path for path in sorted(_paths(page)) if not (ROOT / path).exists()] == []


def test_every_file_of_the_tour_exists() -> None:
    """Also those that are named without their room."""
    named = set(re.findall(r"`([\w/]+\.(?:py|js|yaml))`", (ROOT / "docs" / "architecture.md").read_text()))
    there = [path.as_posix() for top in TOPS for path in (ROOT / top).rglob("*.*")]
    assert len(named) > 40
    assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in there)] == []


def test_files_of_the_tour_are_in_the_rooms_that_they_are_named_with() -> None:
    """In tables whose first column is the room, or empty where it is that of the row above."""
    rooms: list[Path] = []
    astray: list[str] = []
    checked = 0
    for line in (ROOT / "docs" / "architecture.md").read_text().splitlines():
        cells = line.strip("|").split("|")
        if not line.startswith("|") or cells[0].strip() == "room":
            rooms = []
            continue
        if (names := re.findall(r"`([\w/]+)`", cells[0])) and cells[0].strip().startswith("`"):
            first = ROOT / names[0]
            rooms = [first, *(place for name in names[1:] for place in (ROOT / name, first.parent / name))]
        for file in re.findall(r"`([\w/]+\.(?:py|h))`", cells[1]) if len(cells) == 3 and rooms else ():
            checked += 1
            if not any((room / file).exists() for room in (ROOT, *rooms)):
                astray.append(f"{cells[0].strip()}: {file}")
    assert checked > 40 and astray == []


def test_the_picture_shows_the_rooms_of_this_checkout() -> None:
    """`python docs/rooms.py` draws it anew."""
    drawn = runpy.run_path(str(ROOT / "docs" / "rooms.py"))
    assert drawn["PICTURE"].read_text() == drawn["picture"]()
