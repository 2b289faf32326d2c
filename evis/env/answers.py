"""Checks what a task says of its environments: rewards, ends and what goes into `info`."""

from __future__ import annotations

from typing import Any

import numpy as np


def of_each(name: str, values: Any, envs: int) -> np.ndarray:
    """Checks what a task says of every environment [E]. name: reward or terminated. Raises ValueError for another
    shape, which numpy would spread."""
    found = np.asarray(values)
    if found.dtype.kind not in "biuf":
        raise ValueError(f"{name} of the task is {values!r:.60}; it must be numbers [{envs}], one for each")
    if found.shape not in ((), (envs,)):
        raise ValueError(f"{name} of the task has shape {list(found.shape)}; it must be [{envs}], one for each")
    return found


def told(name: str, value: Any, envs: int) -> np.ndarray:
    """Spreads what a task tells over all environments [E, ...]; a single value is that of each. Raises ValueError."""
    found = np.asarray(value)
    if not found.ndim:
        return np.repeat(found, envs)
    if len(found) != envs:
        raise ValueError(f"info {name} of the task has shape {list(found.shape)}; its first axis must be {envs}")
    return found
