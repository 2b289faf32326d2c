"""Calls of `evis events simulate` in this process, and what they wrote."""

from __future__ import annotations

import argparse
import json

from evis.cli import events as command
from evis.events import open_recording


def parse(*arguments) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="evis events")
    command.add_arguments(parser)
    return parser.parse_args([str(a) for a in arguments])


def call(capsys, *arguments) -> dict:
    assert command.run(parse("simulate", *arguments, "--json")) == 0
    return json.loads(capsys.readouterr().out)


def read(path):
    with open_recording(path) as recording:
        return recording.read()
