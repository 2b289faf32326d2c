"""Has Warp compile anew what is damaged in its cache of compiled kernels.

Warp syncs nothing there to the disk: where the machine dies soon after, files are left that are empty, cut short or
full of zeros. Every later run would find them and fail.
"""

from __future__ import annotations

import contextlib
import json
import struct
from functools import cache
from pathlib import Path
from typing import Any

from warp._src import context  # nothing public is called before a load; pyproject.toml bounds Warp to such versions

_ELF64 = b"\x7fELF\x02"
_HEAD = 64
"""Bytes of the head of an ELF file."""


@cache
def renew_damaged() -> None:
    """Has each module of kernels looked through when it is loaded, and its damaged files removed before."""
    compile_ = context.Module._compile

    def compile_unless_whole(
        self: Any, device: Any, output_dir: Any = None, output_name: Any = None, *args: Any, **options: Any
    ) -> Any:
        if output_dir is not None and output_name is not None:
            folder = Path(output_dir)
            for path in (folder / output_name, *folder.glob("*.meta")):
                with contextlib.suppress(OSError):  # none there, or a cache in which nothing can be removed
                    if not _is_whole(path):
                        path.unlink()
        return compile_(self, device, output_dir, output_name, *args, **options)

    context.Module._compile = compile_unless_whole  # type: ignore[method-assign, assignment]


def _is_whole(path: Path) -> bool:
    """Tells whether a file has what its head announces. Raises OSError."""
    if path.suffix == ".meta":
        try:
            json.loads(path.read_bytes())
        except ValueError:
            return False
        return True
    with open(path, "rb") as file:
        head = file.read(_HEAD)
    if head.startswith(_ELF64) and len(head) == _HEAD:
        (sections,) = struct.unpack_from("<Q", head, 40)
        entry, count = struct.unpack_from("<HH", head, 58)
        return path.stat().st_size >= sections + entry * count
    return bool(head.strip(b"\0")) and not head.startswith(_ELF64)
