"""Checks that dataset.json says what readers go by: it may be damaged, or another's word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.dataset.errors import DatasetError
from evis.dataset.names import below

_WHOLE: Mapping[str, Any] = {"recipe": dict, "recipe_digest": str, "layout": str, "sequences": list, "failed": list}
_SEQUENCE: Mapping[str, Any] = {
    "index": int, "name": str, "split": str, "path": str, "scene": str, "seed": int, "arguments": dict,
    "duration_s": (int, float), "events": int, "files": dict,
}  # fmt: skip


def check_index(index: dict[str, Any], out: str) -> None:
    """Raises DatasetError in one line for a dataset.json that lacks something, or names files outside of its folders.

    out: the data set, as its user named it.
    """
    try:
        _typed(index, _WHOLE, "it")
        _typed(index["recipe"], {"name": str}, "its recipe")
        for number, entry in enumerate(index["sequences"]):
            _typed(entry, _SEQUENCE, f"sequence {number}")
            for name in (entry["path"], *entry["files"]):
                below(name)
    except ValueError as error:
        raise DatasetError(
            f"{out}: dataset.json is damaged, or no work of evis ({error}); fetch it again, or remove it and make the "
            "data set with --resume"
        ) from None


def _typed(table: Any, kinds: Mapping[str, Any], what: str) -> None:
    """Raises ValueError unless a map has these keys, each of its kind."""
    if not isinstance(table, dict):
        raise ValueError(f"{what} is no map")
    for name, kind in kinds.items():
        if not isinstance(table.get(name), kind):
            raise ValueError(f"{what} has the {name} {table[name]!r:.60}" if name in table else f"{what} has no {name}")
