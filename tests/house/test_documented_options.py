"""Every option of the command line and every argument of the launch files is named in README or docs."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from evis.cli import COMMANDS, module_of
from evis.cli.parser import Parser
from evis.config import paths
from evis.launch.files import load
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


@pytest.mark.parametrize("name", paths.names("launch"))
def test_every_argument_is_told(name: str) -> None:
    """All but `scene_args`, in whose place the scene's own arguments are given."""
    assert [key for key in load(paths.find_launch(name)[0]).arguments if key != "scene_args" and not _named(key)] == []
