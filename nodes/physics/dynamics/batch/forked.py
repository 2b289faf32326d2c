"""Keeps MuJoCo's batches from being freed in a process that was forked from the one that made them.

A batch ends its threads when it is freed, and waits for them. A forked process does not have them, and would wait for
ever as soon as it collects garbage in which its parent left a batch.
"""

from __future__ import annotations

import ctypes
import os
import weakref
from typing import Any

from mujoco.batch import Batch

_batches: weakref.WeakSet[Any] = weakref.WeakSet()


def keep_when_forked(batch: Batch) -> None:
    """Has every process that is forked from this one keep a batch to its end."""
    # What has the threads, which arrays may hold longer than the batch lives.
    _batches.add(batch.state.base)


def _keep_all() -> None:
    """Adds a reference to each batch that nobody gives back, not even the interpreter when it ends."""
    for batch in _batches:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(batch))


os.register_at_fork(after_in_child=_keep_all)
