"""Scenes that the nodes of a process share, so that none is loaded twice while its files stay as they are."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.load import find_scene, load_scene
from evis.scene.model import Scene
from evis.scene.sources import Stamp, noting, unchanged

KEPT = 4
"""Scenes that are kept when nobody uses them any more, the last ones: of two worlds, all and what moves alone."""


@dataclass
class _Loaded:
    scene: Scene
    files: dict[Path, Stamp]


_loaded: OrderedDict[Hashable, _Loaded] = OrderedDict()


def shared_scene(name_or_path: str, overrides: Mapping[str, Any], *, visuals: bool = True) -> Scene:
    """Loads a scene as `load_scene` does, or gives the one that was loaded before with the same arguments.

    Nobody may write to it: its arrays are read-only. Raises as load_scene does.
    """
    arguments = tuple(sorted((key, type(value).__name__, str(value)) for key, value in overrides.items()))
    key = str(find_scene(name_or_path).absolute()), arguments, visuals
    known = _loaded.get(key)
    if known is None or not unchanged(known.files):
        with noting() as files:
            known = _Loaded(load_scene(name_or_path, overrides, visuals=visuals), files)
        lock(known.scene)
        _loaded[key] = known
    _loaded.move_to_end(key)
    while len(_loaded) > KEPT:
        _loaded.popitem(last=False)
    return known.scene


def lock(part: Any) -> None:
    """Makes all arrays of a scene, or of a part of one, read-only."""
    if isinstance(part, np.ndarray):
        part.flags.writeable = False
    elif isinstance(part, (list, tuple)):
        for each in part:
            lock(each)
    elif is_dataclass(part) and not isinstance(part, type):
        for each in fields(part):
            lock(getattr(part, each.name))
