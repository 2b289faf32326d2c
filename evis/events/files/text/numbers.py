"""Parses lines of numbers to integers, exactly: no time goes through a float."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal, InvalidOperation
from typing import TYPE_CHECKING

import numpy as np

from evis.events.files.text.columns import plain

if TYPE_CHECKING:
    from evis.events.files.text.columns import Format

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]

_DIGIT, _POINT, _MINUS, _SPACE, _END, _OTHER = range(6)
_KIND = np.full(256, _OTHER, np.uint8)
_KIND[48:58] = _DIGIT
_KIND[[ord(c) for c in " \t,;\r"]] = _SPACE
_KIND[ord(".")], _KIND[ord("-")], _KIND[ord("\n")] = _POINT, _MINUS, _END
_POWERS = 10 ** np.arange(19, dtype=np.int64)
_LIMITS = np.iinfo(np.int64)


def parse_lines(data: bytes, form: Format) -> Columns:
    """Parses whole lines to t int64 [ns], x uint16, y uint16, p uint8, and the number of lines left out.

    Numbers of plain digits are read all at once; a block with anything else (exponents, comments) line by line.
    """
    if b"e" in data or b"E" in data:  # exponents, or true and false
        data = plain(data)
    fast = _fast(data, form)
    return fast if fast is not None else _slow(data, form)


def _fast(data: bytes, form: Format) -> Columns | None:
    raw = np.frombuffer(data, np.uint8)
    kind = _KIND[raw]
    digit = kind == _DIGIT
    solid = kind < _SPACE
    if (kind == _OTHER).any():
        return None
    begins = solid.copy()
    begins[1:] &= ~solid[:-1]
    starts = np.flatnonzero(begins)
    line_ends = np.flatnonzero(kind == _END)
    n, width = len(line_ends), len(form.columns)
    if len(starts) != width * n:
        return None
    last = solid.copy()
    last[:-1] &= ~solid[1:]
    ends = np.flatnonzero(last) + 1
    # the words of a line lie between its end and the one before
    if n and ((starts[width - 1 :: width] > line_ends).any() or (starts[width::width] < line_ends[:-1]).any()):
        return None
    # a digit counts 10^(digits behind it in its word)
    total = np.zeros(len(raw) + 1, np.int32)
    np.cumsum(digit, out=total[1:])
    digits = total[ends] - total[starts]
    points = np.flatnonzero(kind == _POINT)
    minus = np.flatnonzero(kind == _MINUS)
    if digits.min(initial=1) < 1 or digits.max(initial=0) > 18:
        return None
    word_of_point = np.searchsorted(starts, points, "right") - 1
    word_of_minus = np.searchsorted(starts, minus, "right") - 1
    if (np.diff(word_of_point) == 0).any() or (starts[word_of_minus] != minus).any():
        return None
    places = np.flatnonzero(digit)
    word = np.cumsum(begins, dtype=np.int32)[places] - 1
    behind = total[ends][word] - total[places] - 1
    value = np.add.reduceat((raw[places] - 48) * _POWERS[behind], total[starts]) if n else np.empty(0, np.int64)
    value[word_of_minus] *= -1
    decimals = np.zeros(width * n, np.int64)
    decimals[word_of_point] = total[ends][word_of_point] - total[points]
    return _columns(value.reshape(n, width), decimals.reshape(n, width), digits.reshape(n, width), form)


def _columns(value: np.ndarray, decimals: np.ndarray, digits: np.ndarray, form: Format) -> Columns | None:
    place = form.columns.index("t")
    scale = len(str(form.unit)) - 1
    shift = scale - decimals[:, place]
    t = value[:, place]
    if (digits[:, place] + np.maximum(shift, 0) > 18).any():
        return None
    up, down = _POWERS[np.maximum(shift, 0)], _POWERS[np.maximum(-shift, 0)]
    t = np.sign(t) * ((np.abs(t) * up + down // 2) // down) if (shift < 0).any() else t * up
    columns = {}
    for name in "xyp":
        i = form.columns.index(name)
        columns[name] = value[:, i] // _POWERS[decimals[:, i]]
        if (columns[name] * _POWERS[decimals[:, i]] != value[:, i]).any():
            return None
    x, y, p = columns["x"], columns["y"], columns["p"]
    good = (x >= 0) & (x < 65536) & (y >= 0) & (y < 65536) & (p >= -1) & (p <= 1)
    if not good.all():
        t, x, y, p = t[good], x[good], y[good], p[good]
    return t, x.astype(np.uint16), y.astype(np.uint16), (p == 1).astype(np.uint8), int(np.count_nonzero(~good))


def _slow(data: bytes, form: Format) -> Columns:
    rows, bad = [], 0
    for line in data.split(b"\n"):
        words = line.replace(b",", b" ").replace(b";", b" ").split()
        if not words or words[0].startswith((b"#", b"%")):
            continue
        row = _row(words, form) if len(words) == len(form.columns) else None
        if row is None:
            bad += 1
        else:
            rows.append(row)
    table = np.array(rows, np.int64).reshape(-1, 4)
    t, x, y, p = table.T
    return t.copy(), x.astype(np.uint16), y.astype(np.uint16), (p == 1).astype(np.uint8), bad


def _row(words: list[bytes], form: Format) -> tuple[int, int, int, int] | None:
    try:
        values = {n: Decimal(w.decode("ascii")) for n, w in zip(form.columns, words) if n != "_"}
        if any(not v.is_finite() or v.adjusted() > 18 for v in values.values()):
            return None
        t = int((values["t"] * form.unit).to_integral_value(ROUND_HALF_UP))
        x, y, p = (int(values[n]) for n in "xyp")
    except (InvalidOperation, UnicodeDecodeError):
        return None
    whole = all(values[n] == int(values[n]) for n in "xyp")
    if not whole or not (0 <= x < 65536 and 0 <= y < 65536 and -1 <= p <= 1 and _LIMITS.min <= t <= _LIMITS.max):
        return None
    return t, x, y, p
