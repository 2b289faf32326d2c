"""Pairs the events of two streams pixel by pixel, and measures their time errors, missed and extra events.

Pairs keep their order within a pixel and polarity; their cost is the time between them, that of an event without a
partner UNPAIRED_NS, and the pairing of least total cost is taken. Two events further apart than twice that never pair.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from bench.event_sensor.alignment_kernels import pair_events
from evis.events.measure.distance import EventStream

UNPAIRED_NS = 4_000_000
CELLS_AT_ONCE = 1 << 26
"""Cells of the dynamic programme held at a time, one byte each."""


@dataclass(frozen=True)
class Alignment:
    """Holds the result of `align`.

    error_ns: test minus reference of every pair, int64. missed, extra: events without a partner in the other."""

    error_ns: np.ndarray
    missed: int
    extra: int
    reference: int

    def figures(self) -> dict[str, float]:
        """Gives the columns of a table: median and 99th percentile of |error| [us], missed and extra [%]."""
        error = np.abs(self.error_ns) / 1e3
        median, most = np.quantile(error, (0.5, 0.99)) if len(error) else (np.nan, np.nan)
        total = max(self.reference, 1)
        return {
            "median [us]": float(f"{median:.3g}"),
            "p99 [us]": float(f"{most:.3g}"),
            "missed [%]": round(100 * self.missed / total, 4),
            "extra [%]": round(100 * self.extra / total, 4),
        }


def align(test: EventStream, reference: EventStream, unpaired_ns: int = UNPAIRED_NS) -> Alignment:
    """Pairs the events of two streams of the same sensor."""
    (ta, offsets_a), (tb, offsets_b) = test.trains(), reference.trains()
    n_a, n_b = np.diff(offsets_a), np.diff(offsets_b)
    partner: wp.array = wp.full(len(tb), -1, dtype=wp.int64, device="cpu")
    trains: list[wp.array] = [
        wp.array(np.ascontiguousarray(a), dtype=wp.int64, device="cpu") for a in (ta, offsets_a, tb, offsets_b)
    ]
    cells = np.concatenate([[0], np.cumsum(n_a * n_b)])
    rows = np.concatenate([[0], np.cumsum(n_b + 1)])
    first = 0
    while first < len(n_a):
        last = int(np.searchsorted(cells, cells[first] + CELLS_AT_ONCE, "right")) - 1
        last = min(max(last, first + 1), len(n_a))
        part = slice(first, last + 1)
        starts: list[wp.array] = [wp.array(a[part] - a[first], dtype=wp.int64, device="cpu") for a in (cells, rows)]
        row: wp.array = wp.empty(int(rows[last] - rows[first]), dtype=wp.int64, device="cpu")
        choice: wp.array = wp.empty(max(1, int(cells[last] - cells[first])), dtype=wp.uint8, device="cpu")
        given = [first, *trains, unpaired_ns, *starts, row, choice]
        wp.launch(pair_events, last - first, given, [partner], device="cpu")
        first = last
    matched = partner.numpy()
    paired = matched >= 0
    error = ta[matched[paired]] - tb[paired] if len(ta) else np.zeros(0, np.int64)
    return Alignment(error, int((~paired).sum()), len(ta) - int(paired.sum()), len(tb))
