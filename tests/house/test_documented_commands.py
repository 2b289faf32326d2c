"""What README and docs tell to type: commands, options, arguments and modules that exist, and a scene that loads."""

from __future__ import annotations

import importlib
import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from evis import paths
from evis.cli import COMMANDS
from evis.cli.parser import Parser
from evis.launch.arguments import parse_pairs
from evis.launch.files import load
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


@pytest.mark.parametrize(("page", "line"), EVIS)
def test_a_command_is_understood(page: str, line: str) -> None:
    """By its parser; the arguments of a launch file are its own or its scene's."""
    _, command, *words = shlex.split(line)
    assert command in COMMANDS
    module = importlib.import_module(f"evis.cli.{command}")
    parser = Parser(f"evis {command}", module.HELP, "", words)
    module.add_arguments(parser)
    args = parser.parse_intermixed_args(words) if getattr(module, "INTERMIXED", False) else parser.parse_args(words)
    if command == "launch":
        name = "spinning_disk" if args.target == "SCENE" else args.target
        path, preset = paths.find_launch(name)
        known = {**load(path).arguments, **(scene_args(preset["scene"]) if preset else {})}
        assert parse_pairs(args.pairs).keys() <= known.keys()


def test_every_command_in_the_text_exists() -> None:
    """`evis COMMAND ...` in a sentence."""
    for page in PAGES:
        for command, word in re.findall(r"`evis ([a-z]+)(?: ([a-z_]+))?[ `]", page.read_text()):
            assert command in COMMANDS, (page.name, command)
            if command == "bench" and word:
                from bench.report import SUBJECTS

                assert word in SUBJECTS, (page.name, word)


def test_every_module_that_is_to_be_run_exists() -> None:
    """`python -m package.module`, and `bench.module` beside it."""
    for page in PAGES:
        text = page.read_text()
        for module in {*re.findall(r"python -m ([\w.]+)", text), *re.findall(r"`(bench\.\w+)`", text)}:
            assert importlib.util.find_spec(module), (page.name, module)


def test_the_scene_on_the_page_of_scenes_loads(tmp_path: Path) -> None:
    """The whole one; the others are parts."""
    text = next(body for page, body in _blocks("yaml") if page == "scenes.md" and "cameras:" in body)
    (tmp_path / "ball.yaml").write_text(text)
    scene = load_scene(str(tmp_path / "ball.yaml"), {"radius": 0.2})
    assert [camera.name for camera in scene.cameras] == ["cam0"] and len(scene.instances) == 1
