"""README and docs name every option of the command line, argument of a launch file, and key of a scene and a recipe."""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from evis.cli import COMMANDS, module_of
from evis.cli.parser import Parser
from evis.config import paths
from evis.dataset import recipe_file
from evis.launch.files import load
from evis.scene.yaml import build
from nodes.event_sensor.parameters import SENSOR

ROOT = Path(__file__).parents[2]
TEXT = "\n".join(page.read_text() for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))])
OF_THE_SENSOR = {f"--{name.replace('_', '-')}" for name in (*SENSOR, "defocus")}
"""They are called as the parameters, which docs/event_sensor.md lists."""


def _named(word: str) -> bool:
    return re.search(rf"(?<![\w-]){re.escape(word)}(?![\w-])", TEXT) is not None


def _options(parser: argparse.ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from _options(child)
        yield from (option for option in action.option_strings if option.startswith("--"))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_told(command: str) -> None:
    module = module_of(command)
    parser = Parser(f"evis {command}", module.HELP, "", [])
    module.add_arguments(parser)
    known = {"--help", *OF_THE_SENSOR}
    assert [option for option in _options(parser) if option not in known and not _named(option)] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_and_action_is_told(command: str) -> None:
    module = module_of(command)
    parser = Parser(f"evis {command}", module.HELP, "", [])
    module.add_arguments(parser)
    assert re.search(rf"(?<!\w)evis {command}\b", TEXT)
    actions = [word for a in parser._actions if isinstance(a, argparse._SubParsersAction) for word in a.choices]
    assert [word for word in actions if not re.search(rf"(`|evis {command} ){word}\b", TEXT)] == []


@pytest.mark.parametrize("name", paths.names("launch"))
def test_every_argument_is_told(name: str) -> None:
    """All but `scene_args`, in whose place the scene's own arguments are given."""
    assert [key for key in load(paths.find_launch(name)[0]).arguments if key != "scene_args" and not _named(key)] == []


def test_the_keys_of_a_scene_are_those_of_its_reader() -> None:
    """Which has them in its docstring, indented."""
    page = (ROOT / "docs" / "scenes.md").read_text().partition("## All keys")[2]
    shown = re.findall(r"^```\n(.*?)^```", page, re.M | re.S)[0]
    known = "\n".join(line for line in str(build.__doc__).splitlines() if line.startswith("    ") or not line)
    assert shown.strip() == textwrap.dedent(known).strip()


def test_every_key_of_a_recipe_is_told() -> None:
    page = (ROOT / "docs" / "dataset.md").read_text()
    assert [
        key for key in (*recipe_file.KEYS, *recipe_file.OTHERS) if not re.search(rf"`{key}`|^{key}:", page, re.M)
    ] == []
