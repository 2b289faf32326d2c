"""Keeps MuJoCo from taking a mesh or picture that has been rewritten for what it has read of it before.

MuJoCo keeps decoded files of a process in a cache, by their names and the whole second of their last change.
"""

from __future__ import annotations

from pathlib import Path

import mujoco

from evis.scene.sources import Stamp, stamp

_named: dict[Path, Stamp] = {}
"""How files were when a model of this process named them last, since the cache was emptied."""


def refresh_cache(path: Path) -> Path:
    """Empties MuJoCo's cache where a file has changed since a model of this process named it, and returns the file.

    Without a change the cache stays: a mesh of 10,000 vertices is read from it in a tenth of the time.
    """
    real = path.absolute()
    now = stamp(real)
    if _named.setdefault(real, now) != now:
        mujoco.mj_clearCache(mujoco.mj_getCache())
        _named.clear()
        _named[real] = now
    return path
