"""Keeps what is known of a finished sequence: its entry in the index, with a checksum of every file."""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from evis.dataset.recipe import Plan

ENTRY = "sequence.json"
"""Lies in the folder of every finished sequence: dataset.json is made of these."""
BLOCK = 1 << 20
AT_ONCE = 8
"""Files that are brought to the disk at the same time: a file system writes several in one go."""


@dataclass(frozen=True)
class Entry:
    """Describes a finished sequence. files: path below its folder -> sha256. notes: what its layout cannot
    hold.
    """

    plan: Plan
    duration_ns: int
    events: int
    files: dict[str, str]
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Converts the entry to a dictionary of plain types, as dataset.json holds it."""
        plan = self.plan
        return {
            "index": plan.index,
            "name": plan.name,
            "split": plan.split,
            "path": plan.path,
            "scene": plan.scene_name,
            "seed": plan.seed,
            "arguments": plan.arguments,
            "labels": list(plan.labels),
            "duration_s": self.duration_ns / 1e9,
            "events": self.events,
            "notes": list(self.notes),
            "files": self.files,
        }


def sha256_of(path: Path, sync: bool = False) -> str:
    """Returns the checksum of a file. sync: bring it to the disk too."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
        if sync:
            os.fsync(file.fileno())
    return digest.hexdigest()


def files_of(folder: Path) -> dict[str, str]:
    """Brings all files below a folder to the disk, and returns their checksums by path."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    with ThreadPoolExecutor(AT_ONCE) as hands:
        digests = hands.map(partial(sha256_of, sync=True), files)
        return {path.relative_to(folder).as_posix(): digest for path, digest in zip(files, digests)}
