"""docs/event_sensor.md says what the tables of parameters and presets say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from nodes.event_sensor.parameters import CROSSINGS, SENSOR
from nodes.event_sensor.peers import MODELS
from nodes.event_sensor.presets import PRESETS

DOC = Path(__file__).parents[2] / "docs" / "event_sensor.md"


def parameter_cells() -> dict[str, list[str]]:
    """Name -> what stands in the first five columns."""
    rows = {}
    for name, p in SENSOR.items():
        upwards = f"to {p.maximum:g}" if p.maximum is not None else "or more"
        limits = ", ".join(map(str, p.choices)) or f"{p.minimum:g} {upwards}"
        default = "as threshold" if p.default is None else f"{p.default:g}" if p.type is not str else p.default
        rows[name] = [f"`{name}`", p.help, p.unit or "-", limits, default]
    return rows


def preset_rows() -> list[str]:
    """One row per parameter, one column per preset; guesses in italics."""
    names = [name for name, preset in PRESETS.items() if preset.values]
    keys = [key for key in SENSOR if any(key in PRESETS[name].values for name in names)]
    rows = ["| | " + " | ".join(f"`{name}`" for name in names) + " |", "|---" * (len(names) + 1) + "|"]
    rows.append("| pixels | " + " | ".join(f"{PRESETS[n].width} x {PRESETS[n].height}" for n in names) + " |")
    for key in keys:
        cells = []
        for name in names:
            preset = PRESETS[name]
            value = f"{preset.values[key]:.4g}" if key in preset.values else "-"
            cells.append(f"*{value}*" if "guess" in preset.sources.get(key, "") else value)
        rows.append(f"| `{key}` | " + " | ".join(cells) + " |")
    return rows


def table(name: str) -> list[str]:
    """Lines of a table of the page, without its head."""
    text = DOC.read_text(encoding="utf-8")
    found = re.search(rf"<!-- {name} -->\n(.*?)<!-- end -->", text, re.S)
    assert found, f"the page has no table between <!-- {name} --> and <!-- end -->"
    return found[1].strip().splitlines()


def test_every_parameter_is_described_as_it_is() -> None:
    """Name, meaning, unit, range and default of each, in order; typical range and source are there."""
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table("parameters")[2:]]
    assert [row[:5] for row in rows] == list(parameter_cells().values())
    for row in rows:
        assert len(row) == 7 and all(len(cell) > 0 for cell in row[5:]), row


def test_every_preset_is_described_as_it_is() -> None:
    """Values to four digits, guesses marked."""
    assert table("presets") == preset_rows()


@pytest.mark.parametrize("name", [*CROSSINGS, *MODELS, "evis-paper", *PRESETS])
def test_every_choice_is_explained(name: str) -> None:
    """Crossing methods, models and presets each have a place on the page."""
    assert f"`{name}`" in DOC.read_text(encoding="utf-8")


def test_commands_and_names_on_the_page_exist() -> None:
    """Every option of `evis events simulate` on the page is one, every file is there."""
    import argparse

    from evis.cli import events

    parser = argparse.ArgumentParser()
    events.add_arguments(parser)
    actions = parser._subparsers._group_actions[0].choices  # type: ignore[union-attr]
    known = {option for action in actions.values() for option in action._option_string_actions}
    text = DOC.read_text(encoding="utf-8")
    for command in re.findall(r"^evis events .*$", text, re.M):
        assert set(re.findall(r"(?<=\s)--[a-z-]+", command)) <= known, command
    for path in re.findall(r"`((?:nodes|bench|launch)/[\w/.]+)`", text):
        assert (DOC.parents[1] / path).exists(), path
