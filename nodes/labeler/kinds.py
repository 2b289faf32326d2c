"""Lists the kinds of labels, and what each of them is made of."""

from __future__ import annotations

from typing import Any

from evis.config.suggestions import nearest
from msgs.camera import INTERVAL_FLOWS

NEEDS = {
    "flow": {"state", "depth", "ids", "info"},
    "depth": {"depth"},
    "segmentation": {"ids"},
    "semantic": {"ids", "info"},
    "boxes": {"ids"},
    "poses": {"state"},
    "velocities": {"state"},
    "accelerations": {"state"},
    "joints": {"state"},
    "contacts": {"state"},
    "boxes3d": {"state"},
    "forward_flow": {"state"},
    "backward_flow": {"state"},
    "events": {"state", "events", "signal"},
}
"""Inputs that each kind of label is made of."""
RAY_CAST = frozenset({"events", *INTERVAL_FLOWS})
"""Labels of surfaces at instants that no image shows: rays are cast at the scene's meshes."""
OF_MESHES = RAY_CAST | {"boxes3d"}
"""Labels for which the scene is loaded: they look at its meshes."""
DEFAULT = ("flow", "depth", "segmentation", "boxes")
"""Kinds for a reader who did not say which."""


def kinds_of(asked: Any) -> list[str]:
    """Gives the labels asked for, those of DEFAULT for None. Raises ValueError that names the nearest one."""
    names = [n.strip() for n in asked.split(",")] if isinstance(asked, str) else [str(n) for n in asked or DEFAULT]
    for name in names:
        if name not in NEEDS:
            raise ValueError(f"no label '{name}'; {nearest(name, NEEDS)}")
    return names
