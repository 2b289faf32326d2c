"""Arguments of MuJoCo's engine by their single names, as tests vary them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from nodes.physics.interval import Extras
from nodes.physics.precision.stepping import Stepping


def grouped(**given: Any) -> dict[str, Any]:
    """Puts what belongs to Stepping and to Extras into one; the others stay."""
    groups: dict[str, Any] = {"stepping": Stepping, "extras": Extras}
    for key, kind in groups.items():
        groups[key] = kind(**{f.name: given.pop(f.name) for f in fields(kind) if f.name in given})
    return groups | given
