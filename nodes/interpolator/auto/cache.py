"""Keeps on disk what was measured of a setting, under a key of all that it depends on.

These are the scene's content, how it is run, the machine, and the code itself.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.home import user_folder
from nodes.interpolator.auto.setting import Setting
from nodes.interpolator.auto.trial import Measured

CODE = {
    "nodes": ("renderer/**/*.py", "interpolator/**/*.py", "event_sensor/**/*.py", "physics/**/*.py"),
    "evis": ("geometry/**/*.py", "scene/**/*.py", "events/measure/distance*.py"),
}
"""Files whose content decides cost and error, by package."""


def read(setting: Setting) -> Measured | None:
    """Reads what was measured of a setting; None where nothing is kept."""
    try:
        return Measured.of_json(json.loads(path_of(setting).read_text()))
    except (OSError, ValueError, TypeError, KeyError):
        return None


def write(setting: Setting, found: Measured) -> None:
    """Keeps what was measured for the next time. Raises OSError where that cannot be written."""
    path = path_of(setting)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps(found.as_json(), indent=1))
    part.replace(path)


def path_of(setting: Setting) -> Path:
    """Gives the file in which the measurements of a setting are kept."""
    return cache_folder() / f"{fingerprint(setting)}.json"


def cache_folder() -> Path:
    """Gives the folder in which measurements are kept. Raises OSError without a home."""
    return user_folder("XDG_CACHE_HOME", ".cache") / "evis" / "auto"


def fingerprint(setting: Setting) -> str:
    """Computes a hash, 32 hexadecimal digits, of all that cost and error depend on."""
    from importlib.metadata import version

    import warp

    found = hashlib.sha256(code_digest())
    _digest(found, setting)

    machine = [platform.node(), platform.machine(), os.cpu_count(), platform.python_version(), warp.config.version]
    if setting.device.startswith("cuda"):
        warp.init()
        machine.append(warp.get_device(setting.device).name)
    found.update(repr([machine, version("evis"), np.__version__]).encode())
    return found.hexdigest()[:32]


@functools.cache
def code_digest() -> bytes:
    """Computes a hash of the code that is measured and of the code that measures it, as it was at the first call."""
    from evis.neighbours import ROOT

    found = hashlib.sha256()
    for package, patterns in CODE.items():
        root = Path(ROOT, package)
        for path in sorted(path for pattern in patterns for path in root.glob(pattern)):
            found.update(path.relative_to(root).as_posix().encode())
            found.update(path.read_bytes())
    return found.digest()


def _digest(found: Any, value: Any) -> None:
    """Adds a value to a hash: its fields and elements, whatever its type."""
    found.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        found.update(repr((value.shape, value.dtype.str)).encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Path):
        found.update(value.read_bytes() if value.is_file() else str(value).encode())
    elif isinstance(value, Mapping):
        for key in value:
            _digest(found, key)
            _digest(found, value[key])
    elif isinstance(value, (list, tuple)):
        for item in value:
            _digest(found, item)
    elif callable(value):
        found.update(value.__qualname__.encode() if hasattr(value, "__qualname__") else b"")
    elif hasattr(value, "__dict__"):
        _digest(found, vars(value))
    else:
        found.update(repr(value).encode())
