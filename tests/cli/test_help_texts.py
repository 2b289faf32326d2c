"""What the help says: of every option, of every action, of a scene's own arguments; and wrong usage in its words."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from evis.cli import COMMANDS, main, module_of
from evis.cli.parser import Parser
from evis.config import paths
from evis.launch.files import load
from evis.scene.load import scene_args


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Of every command, and of every action."""
    for command in COMMANDS:
        module = module_of(command)
        parser = Parser(f"evis {command}", module.HELP, getattr(module, "EXAMPLE", ""), [])
        module.add_arguments(parser)
        yield command, parser
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                yield from ((f"{command} {name}", child) for name, child in action.choices.items())


@pytest.mark.parametrize(("name", "parser"), list(parsers()), ids=lambda value: value if isinstance(value, str) else "")
def test_everything_is_explained(name: str, parser: argparse.ArgumentParser) -> None:
    """The command or action itself, an example of it, and each of its options and arguments."""
    assert parser.description and f"evis {name}" in (parser.epilog or "")
    unexplained = [a.dest for a in parser._actions if not a.help and not isinstance(a, argparse._SubParsersAction)]
    assert unexplained == []


def test_the_overview_says_what_a_command_itself_says() -> None:
    """Every action of `events` is in its line."""
    assert COMMANDS["events"][1] == module_of("events").HELP
    for verb in ("convert", "simulate", "measure", "draw"):
        assert verb in COMMANDS["events"][1]


def help_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main([*words, "--help"]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("scene", paths.names("scenes"))
def test_the_help_of_a_scene_lists_its_own_arguments(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = help_of(capsys, "launch", scene)
    for key in scene_args(scene):
        assert f"\n  {key} " in shown
    assert "e+18" not in shown, "where whole numbers end"


@pytest.mark.parametrize("scene", paths.names("scenes"))
def test_no_argument_of_a_scene_is_hidden_by_the_launch_file(scene: str) -> None:
    """`evis launch warehouse pace:=2` was about the wall clock, and the camera's speed could not be given."""
    assert scene_args(scene).keys() & load(paths.find_launch("simulator")[0]).arguments.keys() == {"width", "height"}


def test_the_types_of_nodes_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (("run",), ("node", "info")):
        assert "event_sensor" in help_of(capsys, *words)


def test_a_parameter_that_is_not_given_has_no_default_none(capsys: pytest.CaptureFixture[str]) -> None:
    """Limits and choices stand in its place."""
    assert main(["node", "info", "event_sensor"]) == 0
    shown = capsys.readouterr().out
    assert "None" not in shown and "False" not in shown
    assert "(0.001 to 10 ln I)" in shown and "one of evis, evis-paper," in shown


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run"], "required: NODE ("),
        (["bag", "play"], "required: BAG ("),
        (["launch", "drone", "--duration", "abc"], "--duration is 'abc', must be a number"),
        (["launch", "drone", "--seed", "1.5"], "--seed is '1.5', must be a whole number"),
        (["topic", "hz", "/cam0/events", "--window", "k"], "'k' is no time in seconds"),
        (["topic", "hz", "/cam0/events", "--window", "0"], "'0' is no time in seconds above 0"),
        (["topic", "pub", "/action", "1", "--rate", "0"], "'0' is no rate in Hz above 0, up to 10000"),
        (["events", "rander"], "must be one of info, convert, simulate, measure, fit, render; did you mean 'render'?"),
        (["events", "render", "a.raw", "b.gif", "--style", "time-surfaces"], "did you mean 'time-surface'?"),
    ],
)
def test_wrong_usage_is_told_in_the_programs_words(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(words)
    line = capsys.readouterr().err
    assert status == 2 and told in line and line.count("\n") == 1
    assert "invalid" not in line and "key:=value" not in line


def test_a_drawing_is_refused_before_it_is_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", "drone", "--png", str(tmp_path / "a.txt")]) == 2
    assert main(["graph", "drone", "--png", str(tmp_path / "nowhere" / "a.png")]) == 1
    told = capsys.readouterr().err.splitlines()
    assert "--png writes a .png file" in told[0] and "nowhere does not exist; make it first" in told[1]
    assert not list(tmp_path.iterdir())


def test_grey_frames_in_colour_are_told_by_the_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "f.npz", t=np.arange(2), luminance=np.ones((2, 3, 4), np.float32))
    assert main(["events", "simulate", str(tmp_path / "f.npz"), str(tmp_path / "e.npz"), "--colour"]) == 1
    assert "without --colour" in capsys.readouterr().err


def test_nothing_to_measure_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["events", "measure"]) == 2
    assert "name a recording, or --topic" in capsys.readouterr().err
