"""What is kept of a finished sequence: its entry in the index, with a checksum of every file."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evis.dataset.recipe import Plan

ENTRY = "sequence.json"
"""Lies in the folder of every finished sequence: dataset.json is made of these."""
BLOCK = 1 << 20


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
        """Gives it as dataset.json has it."""
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
    return {path.relative_to(folder).as_posix(): sha256_of(path, sync=True) for path in files}
