"""Counts events, rates and splits of a data set."""

from __future__ import annotations

from collections import Counter
from typing import Any

from evis.dataset.errors import DatasetError
from evis.dataset.index_check import check_index
from evis.dataset.making.store import INDEX_FORMAT, Store, store_of


def opened(out: str) -> tuple[Store, dict[str, Any]]:
    """Returns where a data set lies and its dataset.json. Raises DatasetError where there is none."""
    store = store_of(out)
    index = store.index()
    if index is None:
        raise DatasetError(f"{out} holds no data set; `evis dataset make RECIPE --out {out}` makes one")
    if index.get("format") != INDEX_FORMAT:
        raise DatasetError(f"{out}: dataset.json has the format {index.get('format')}; this evis reads {INDEX_FORMAT}")
    check_index(index, out)
    return store, index


def summary(out: str) -> dict[str, Any]:
    """Sums up a data set: sequences, splits, events, duration. Raises DatasetError."""
    _, index = opened(out)
    sequences = index["sequences"]
    seconds = sum(entry["duration_s"] for entry in sequences)
    events = sum(entry["events"] for entry in sequences)
    wanted = index["recipe"].get("sequences", len(sequences))
    return {
        "recipe": index["recipe"]["name"],
        "recipe_digest": index["recipe_digest"],
        "layout": index["layout"],
        "sequences": len(sequences),
        "of_recipe": wanted,
        "failed": index["failed"],
        "splits": dict(sorted(Counter(entry["split"] for entry in sequences if entry["split"]).items())),
        "scenes": dict(sorted(Counter(entry["scene"] for entry in sequences).items())),
        "labels": index["recipe"].get("labels", []),
        "duration_s": round(seconds, 9),
        "events": events,
        "events_per_s": round(events / seconds, 1) if seconds else 0.0,
        "arguments": _ranges([entry["arguments"] for entry in sequences]),
        "notes": sorted({note for entry in sequences for note in entry.get("notes", [])}),
    }


def _ranges(arguments: list[dict[str, Any]]) -> dict[str, str]:
    """What each argument has been, from least to most, or the values of one that is no number."""
    names = dict.fromkeys(name for each in arguments for name in each)
    found = {}
    for name in names:
        values = [each[name] for each in arguments if name in each]
        rows = [value if isinstance(value, list) else [value] for value in values]
        if len({len(row) for row in rows}) == 1 and all(_is_number(part) for row in rows for part in row):
            low, high = (value_text([end(column) for column in zip(*rows)]) for end in (min, max))
            found[name] = low if low == high else f"{low} to {high}"
        else:
            shown = sorted({value_text(value) for value in values})
            found[name] = ", ".join(shown[:6]) + (f" and {len(shown) - 6} more" if len(shown) > 6 else "")
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def value_text(value: Any) -> str:
    """Writes the value of an argument to four digits, a vector with commas."""
    parts = value if isinstance(value, list) else [value]
    return ",".join(f"{part:.4g}" if isinstance(part, float) else str(part) for part in parts)
