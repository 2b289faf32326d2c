"""Writes presets as files: YAML maps `name: value` of the sensor's parameters, with the source of each value."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

WIDTH = 110
"""Columns of a comment."""


def write_preset(path: str, head: Sequence[str], values: Mapping[str, float], sources: Mapping[str, str]) -> None:
    """Writes a file that `preset:=FILE` takes.

    head: paragraphs of comment at its top. values: parameters of the sensor, by name; sources: where each comes from.
    """
    lines = [line for paragraph in head for line in _comment(paragraph)]
    for name, value in values.items():
        lines += ["", *_comment(sources[name]), f"{name}: {value:.4g}"]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH)] or ["#"]
