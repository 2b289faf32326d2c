"""What README and docs tell to type: commands, options, arguments and modules that exist, and a scene that loads."""

from __future__ import annotations

import argparse
import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from evis.cli import COMMANDS, module_of
from evis.cli.parser import Parser
from evis.config import paths
from evis.launch.arguments import parse_pairs
from evis.launch.files import load
from evis.runtime.node import Node
from evis.scene import load_scene
from evis.scene.load import scene_args

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)


def _blocks(kind: str) -> list[tuple[str, str]]:
    """(page, text) of the code blocks of a kind, and of indented ones where it has no name."""
    found = []
    for page in PAGES:
        text = page.read_text()
        found += [(page.name, body) for name, body in BLOCK.findall(text) if name == kind]
        if not kind:
            found.append((page.name, "\n".join(re.findall(r"^    (\S.*)$", BLOCK.sub("", text), re.M))))
    return found


def _lines(start: str) -> list[tuple[str, str]]:
    """(page, line) of all lines of commands that begin so, without remarks and what they are piped into."""
    return [
        (page, re.split(r"\s+#|\s+\|", line)[0])
        for page, body in _blocks("")
        for line in body.splitlines()
        if line.startswith(start)
    ]


EVIS = _lines("evis ")


def test_there_are_commands_to_look_at() -> None:
    """So that a change of style of the pages is noticed."""
    assert len(EVIS) > 35 and {page for page, _ in EVIS} >= {"README.md", "cameras.md", "event_sensor.md"}


def _written(page: str, target: str, folder: Path) -> str:
    """The file that a page gives below its name, written; any other target as it is."""
    text = next(path for path in PAGES if path.name == page).read_text()
    if found := re.search(rf"`{re.escape(target)}`:\n\n```yaml\n(.*?)^```", text, re.M | re.S):
        (folder / target).write_text(found[1])
        return str(folder / target)
    return target


@pytest.mark.parametrize(("page", "line"), EVIS)
def test_a_command_is_understood(page: str, line: str, tmp_path: Path) -> None:
    """By its parser; the arguments of a launch file are its own or its scene's."""
    _, command, *words = shlex.split(line)
    assert command in COMMANDS
    module = module_of(command)
    parser = Parser(f"evis {command}", module.HELP, "", words)
    module.add_arguments(parser)
    args = parser.parse_intermixed_args(words) if getattr(module, "INTERMIXED", False) else parser.parse_args(words)
    if command == "launch":
        name = "spinning_disk" if args.target == "SCENE" else args.target
        path, preset = paths.find_launch(_written(page, name, tmp_path))
        arguments = load(path).arguments
        scene = preset.get("scene") or ("scene" in arguments and arguments["scene"].param.default)
        known = {**arguments, **(scene_args(scene) if scene else {})}
        assert parse_pairs(args.pairs).keys() <= known.keys()


def _spans() -> list[tuple[str, str]]:
    """(page, words after `evis`) of every command in a sentence or a table."""
    return [
        (page.name, span)
        for page in PAGES
        for span in re.findall(r"`(?:\w+=\w+ )?(?:\.venv/bin/)?evis ([^`]+)`", BLOCK.sub("", page.read_text()))
    ]


def _options(parser: argparse.ArgumentParser) -> set[str]:
    """All options of a command, those of its actions included."""
    found = set(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                found |= _options(child)
    return found


@pytest.mark.parametrize(("page", "span"), _spans())
def test_a_command_in_the_text_exists(page: str, span: str) -> None:
    """`evis COMMAND ...` in a sentence: command, action, options, arguments of a launch file; more may be left out."""
    command, *words = span.split()
    if command.startswith("-"):
        return
    assert command in COMMANDS
    module = module_of(command)
    parser = Parser(f"evis {command}", module.HELP, "", words)
    module.add_arguments(parser)
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= _options(parser)
    actions = [a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if words and actions and re.fullmatch("[a-z]+", words[0]):
        assert words[0] in actions[0]
    if command == "bench":
        from bench.report import SUBJECTS

        assert all(word in SUBJECTS for word in words[:1] if not word.startswith("-"))
    if command == "launch" and (pairs := [word for word in words if ":=" in word]):
        made_up = {"SCENE": "spinning_disk", "arm.xml": str(paths.data_folder("scenes") / "robot_arm.xml")}
        path, preset = paths.find_launch(made_up.get(words[0], words[0]))
        known = {**load(path).arguments, **(scene_args(preset["scene"]) if preset else {})}
        assert parse_pairs(pairs).keys() <= known.keys()


def test_every_argument_in_the_text_exists() -> None:
    """`name:=value` anywhere: of a launch file, of a scene, or of what the same page tells to write."""
    known = {key for name in paths.names("launch") for key in load(paths.find_launch(name)[0]).arguments}
    scenes = [*paths.names("scenes"), str(paths.data_folder("scenes") / "robot_arm.xml")]
    known |= {key for name in scenes for key in scene_args(name)}
    for page in PAGES:
        text = page.read_text()
        # The parameters of a node that `evis run` runs by hand are those that `evis node info` lists.
        unknown = set(re.findall(r"(\w+):=", re.sub(r"^evis run .*", "", text, flags=re.M))) - known
        assert all(f"{name}: {{default: " in text for name in unknown), (page.name, unknown)


def test_there_are_commands_in_the_text() -> None:
    """So that a change of style of the pages is noticed."""
    assert len(_spans()) > 25 and {page for page, _ in _spans()} >= {"README.md", "scenes.md", "CONTRIBUTING.md"}


def test_every_module_that_is_to_be_run_exists() -> None:
    """`python -m package.module --option`, and `bench.module`; the module, or what it runs, has the option."""
    options = 0
    for page in PAGES:
        text = page.read_text()
        for module in {*re.findall(r"python -m ([\w.]+)", text), *re.findall(r"`(bench\.[\w.]+)`", text)}:
            assert importlib.util.find_spec(module), (page.name, module)
        for module, rest in re.findall(r"python -m ([\w.]+)((?: [-\w./]+)*)", text):
            found = importlib.util.find_spec(module)
            assert found is not None and found.origin is not None
            source = Path(found.origin).read_text() + (ROOT / "bench" / "command.py").read_text()
            for option in re.findall(r"--[\w-]+", rest):
                options += 1
                assert f'"{option}"' in source, (page.name, module, option)
    assert options >= 2


def test_the_scene_on_the_page_of_scenes_loads(tmp_path: Path) -> None:
    """The whole one; the others are parts."""
    text = next(body for page, body in _blocks("yaml") if page == "scenes.md" and "cameras:" in body)
    (tmp_path / "ball.yaml").write_text(text)
    scene = load_scene(str(tmp_path / "ball.yaml"), {"radius": 0.2})
    assert [camera.name for camera in scene.cameras] == ["cam0"] and len(scene.instances) == 1


def test_what_contributing_tells_of_nodes_exists() -> None:
    """A class attribute as `NAME = True`, a method as `name(parameters)`, each of every node."""
    text = (ROOT / "CONTRIBUTING.md").read_text().partition("## A new node")[2].partition("## ")[0]
    told = re.findall(r"`(\w+)\([\w, ]+\)`|`(\w+) = \w+`", text)
    assert len(told) >= 3
    for name in {method or attribute for method, attribute in told}:
        assert hasattr(Node, name), name
