"""Holds columns that grow at their end and are forgotten at their beginning, by pieces; numpy's arrays or tensors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from evis.dataset.augmenting.arrays import module_of


class _Piece(NamedTuple):
    """Rows from `first` on, all of (start_ns, end_ns]."""

    first: int
    columns: dict[str, Any]
    start_ns: int
    end_ns: int

    @property
    def end(self) -> int:
        """Returns the number of the row behind the last one."""
        return self.first + len(next(iter(self.columns.values())))


class Rows:
    """Holds rows with their numbers from the start on, of which the first ones may be gone. total: rows ever added."""

    def __init__(self) -> None:
        self._pieces: list[_Piece] = []
        self.total = 0

    def add(self, columns: dict[str, Any], start_ns: int, end_ns: int) -> None:
        """Adds rows of times in (start_ns, end_ns]; those before them end there, whatever was said of them."""
        if self._pieces and self._pieces[-1].end_ns > start_ns:
            self._pieces[-1] = self._pieces[-1]._replace(end_ns=start_ns)
        piece = _Piece(self.total, columns, start_ns, end_ns)
        self._pieces.append(piece)
        self.total = piece.end

    def part(self, first: int, end: int) -> dict[str, Any]:
        """Returns the rows [first, end)."""
        held = [p for p in self._pieces if p.first < end and p.end > first] or self._pieces[-1:]
        found = {}
        for name in held[0].columns if held else ():
            parts = [p.columns[name][max(first - p.first, 0) : max(end - p.first, 0)] for p in held]
            found[name] = parts[0] if len(parts) == 1 else module_of(parts[0]).concatenate(parts)
        return found

    def row_of(self, t_ns: int) -> int:
        """Returns the first row at or after a time, of the column t."""
        for piece in self._pieces:
            if t_ns <= piece.start_ns:
                return piece.first
            if t_ns <= piece.end_ns and piece.end > piece.first:
                t = piece.columns["t"]
                if isinstance(t, np.ndarray):
                    return piece.first + int(np.searchsorted(t, t_ns))
                module = module_of(t)
                return piece.first + int(module.searchsorted(t, module.tensor(t_ns, device=t.device)))
        return self.total

    def time(self, row: int) -> int:
        """Returns t of a row [ns]."""
        return int(self.part(row, row + 1)["t"][0])

    def drop_before(self, t_ns: int) -> int:
        """Forgets pieces that end before a time; returns the number of the first row that is left."""
        while len(self._pieces) > 1 and self._pieces[0].end_ns < t_ns:
            self._pieces.pop(0)
        return self._pieces[0].first if self._pieces else 0

    def drop(self, first: int) -> None:
        """Forgets pieces whose rows are all before one."""
        while len(self._pieces) > 1 and self._pieces[0].end <= first:
            self._pieces.pop(0)
