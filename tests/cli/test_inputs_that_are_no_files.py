"""What is no file where one is to be read: one line that says what it is, in a child whose time and memory are limited.

A pipe that nobody writes to was waited for, and /dev/zero read until the memory was full.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from limited import each_refused, output_of

KINDS: dict[str, Callable[[Path], None]] = {
    "a named pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a socket": lambda path: socket.socket(socket.AF_UNIX).bind(path.name),
}
COMMANDS = {
    "dataset.json": [f"dataset {what} ." for what in ("info", "verify", "show")],
    "mine.yaml": [
        "launch mine.yaml",
        "launch simulator scene:=mine.yaml",
        "launch spinning_disk preset:=mine.yaml",
        "dataset make mine.yaml --out made",
        "events simulate frames.npz out.raw --preset mine.yaml",
    ],
    "mine.xml": ["launch mine.xml"],
    "mine.mcap": ["bag info mine.mcap", "bag play mine.mcap", "view mine.mcap", "bag export mine.mcap --layout npz x"],
    "mine.raw": ["events info mine.raw", "events convert mine.raw out.npz", "camera info --file mine.raw"],
    "mine.npz": ["events simulate mine.npz out.raw", "events info mine.npz"],
    "mine.mp4": ["events simulate mine.mp4 out.raw"],
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_told_in_one_line(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in COMMANDS:
        KINDS[kind](tmp_path / name)
    program = [
        "import contextlib, io, os, sys",
        "from evis.cli import main",
        "os.chdir(sys.argv[1])",
        "for command in sys.argv[2:]:",
        "    with contextlib.redirect_stderr(io.StringIO()) as told:",
        "        status = main(command.split())",
        "    print(status, told.getvalue().strip().replace(chr(10), ' // '))",
    ]
    commands = {command: name for name, several in COMMANDS.items() for command in several}
    lines = output_of("\n".join(program), [tmp_path, *commands]).splitlines()
    for line, (command, name) in zip(lines, commands.items(), strict=True):
        assert line[0] in "12" and " // " not in line, (command, line)
        assert name in line and any(text in line for text in (kind, "a pipe;", "not a file", "is no file")), line


MODELS = {
    "include.xml": '<mujoco><include file="it"/></mujoco>',
    "mesh.xml": '<mujoco><asset><mesh name="m" file="it"/></asset></mujoco>',
    "texture.xml": '<mujoco><asset><texture name="t" type="2d" file="it"/></asset></mujoco>',
    "field.xml": '<mujoco><asset><hfield name="t" file="it" size="1 1 1 1"/></asset></mujoco>',
    "mesh.urdf": '<robot name="r"><link name="l"><visual><geometry><mesh filename="it"/></geometry></visual></link>'
    "</robot>",
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_not_handed_to_mujoco(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It opens whatever it is given, and waits."""
    monkeypatch.chdir(tmp_path)
    KINDS[kind](tmp_path / "it")
    for name, text in MODELS.items():
        (tmp_path / name).write_text(text)
    told = each_refused("__import__('evis').load_scene(argument)", [tmp_path / name for name in MODELS])
    assert all(f"'it' is {kind}, and must be a file" in line for line in told), told
