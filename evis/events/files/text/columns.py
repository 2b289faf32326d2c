"""Finds the meaning of each column of a text file, and the unit of its times."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass

_NAMES = {
    "t": "t", "time": "t", "timestamp": "t", "timestamps": "t", "ts": "t", "t_ns": "t", "t_us": "t", "time_us": "t",
    "timestamp_us": "t", "timestamp_ns": "t", "time_ns": "t", "t_s": "t", "time_s": "t", "timestamp_s": "t",
    "x": "x", "xs": "x", "y": "y", "ys": "y",
    "p": "p", "ps": "p", "pol": "p", "polarity": "p", "polarities": "p", "on": "p",
}  # fmt: skip
_OWN = "t,x,y,p"
"""The line of names that EVIS writes."""
_NUMBER = re.compile(rb"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_BOM = b"\xef\xbb\xbf"
_NAMED_UNIT = re.compile(r"([^,;]+?)[ \t]*[\[(]([^\])]{0,20})[\])]")
_UNIT = re.compile(r"[ \t]*[\[(]([^\])]{0,20})[\])]")
_TRUTH = re.compile(rb"\b(?:(true)|false)\b", re.I)
_MOST_COLUMNS = 32
_ORDERS = ("txyp", "xypt", "xytp", "ptxy", "pxyt")
"""Orders of columns without names."""
_SIZE = re.compile(rb"\s*(?:[#%]\s*)?(?:(?:geometry|width height|size)\s*:?\s*)?(\d{1,5})[ \t,x]+(\d{1,5})\s*", re.I)
_LOOK = 64


@dataclass(frozen=True)
class Format:
    """Describes the lines of a file. columns: what each column is, _ for one that is left out. unit: ns of one unit of
    time. begin: byte of the first event."""

    columns: str
    unit: int
    begin: int
    size: tuple[int, int] = (0, 0)
    assumed: str = ""

    @property
    def name(self) -> str:
        """Returns the description of the columns, for the encoding of `RecordingInfo`."""
        return f"{self.columns.replace('_', '')}, t in {({1: 'ns', 1000: 'us', 10**9: 's'})[self.unit]}"

    @property
    def time_last(self) -> bool:
        """Tells whether a column other than the polarity is the last: a cut line can then be a shorter number."""
        return self.columns[-1] != "p"


def find_format(head: bytes) -> Format | None:
    """Finds the format of a file with this beginning; None where it is not events as text.

    Without names of columns there are four, and polarity is the one that is -1, 0 or 1; behind it may come the time
    (`x,y,p,t`). Times with a decimal point are seconds; whole numbers are us, but ns behind EVIS' own line of names,
    `t_ns`, or where they can be nothing else (1e17 us are 3000 years). So are times whose fractions are all 0 where
    the coordinates are written with such too, as NumPy's `savetxt` writes an array. A column that alone is written with
    fractions, and does not fall, is the time. Orders of columns other than `t x y p` and `x y p t` are known by their
    times, which must go up.

    A tenth of the lines, and of few one, may be damaged. One with a number in it, or behind names, may be the first.
    """
    head = head.rstrip(b"\0")  # pages that were never written
    if b"\0" in head or not head:
        return None
    begin = len(_BOM) if head.startswith(_BOM) else 0
    lines, columns, unit, size = head[begin:].split(b"\n"), "", "", (0, 0)
    if len(lines) > 1 and len(head) >= 4096:
        lines.pop()  # may be cut
    damaged: list[int] = []  # where lines begin
    while lines and (n := len(numbers_in(lines[0], columns))) != (len(columns) or 4):
        if n == 4 == len(columns.strip("_")):
            columns = columns.strip("_")  # a comment's words before or behind the names
            break
        line = lines.pop(0)
        begin += len(line) + 1
        found = _SIZE.fullmatch(line)
        if found and size == (0, 0):
            size = int(found[1]), int(found[2])
        elif (named := _columns_named(line))[0] and not columns:
            (columns, unit), size = named, size if size != (0, 0) else _sensor_size(line)
            damaged.clear()
        elif line.strip() and not line.lstrip().startswith((b"#", b"%")):
            if not columns and not any(map(_NUMBER.fullmatch, re.split(rb"[ \t,;]+", line.strip()))):
                return None
            damaged.append(begin - len(line) - 1)
    begin = min([*damaged, begin])
    own = unit == "own"
    if columns and not lines and len(head) < 4096:  # names, and no event
        return Format(columns, {"own": 1, "ns": 1, "s": 10**9}.get(unit, 1000), min(begin, len(head)), size)
    width = len(columns) or 4
    rows = [words for line in lines[:_LOOK] if len(words := numbers_in(line, columns)) == width]
    looked = len(damaged) + len([line for line in lines[:_LOOK] if line.strip()])
    if not rows or len(rows) < 0.9 * (looked - 1):
        return None
    values = [[float(v) for v in row] for row in rows]
    columns = columns or _guess(values, _columns_with_fractions(rows))
    if not columns:
        return None
    good = [k for k, row in enumerate(values) if _fits(columns, row)] or range(len(rows))
    rows, values = [rows[k] for k in good], [values[k] for k in good]
    place = columns.index("t")
    whole = all(re.fullmatch(rb"[+-]?\d+", row[place]) for row in rows)
    if unit == "s" or not (whole or _are_saved_floats(columns, rows, values)):
        return Format(columns, 10**9, begin, size)
    if own or unit == "ns" or max(abs(row[place]) for row in values) >= 1e17:
        return Format(columns, 1, begin, size, "times are whole numbers: taken as ns" if own else "")
    return Format(columns, 1000, begin, size, "" if unit == "us" else "times are whole numbers: taken as us")


def plain(data: bytes) -> bytes:
    """Replaces true and false by 1 and 0."""
    return _TRUTH.sub(lambda found: b"1" if found[1] else b"0", data)


def numbers_in(line: bytes, columns: str = "") -> list[bytes]:
    """Parses a line that holds only numbers; empty for any other. columns: what each is; those that are left out may be
    of any words, and count as 0."""
    words = re.split(rb"[ \t,;]+", plain(line).strip(b" \t\r,;"), maxsplit=_MOST_COLUMNS)
    if len(words) == len(columns):
        words = [b"0" if column == "_" else word for word, column in zip(words, columns)]
    return words if all(map(_NUMBER.fullmatch, words)) else []


def _columns_named(line: bytes) -> tuple[str, str]:
    """Finds the columns in a line of names: `txyp` in its order, _ for others, and the unit of time that a name states.

    The unit is `own` for the line that EVIS writes; both are empty where not all four are there. A name may have the
    sensor's side behind an @.
    """
    text = line.decode("latin-1").strip()
    units = {found[1].strip('"# \t').lower(): found[2].lower() for found in _NAMED_UNIT.finditer(text)}
    text = _UNIT.sub("", text)
    words = [w.strip('"').lower().partition("@")[0] for w in re.split(r"[ \t]*[,;][ \t]*|[ \t]+", text.lstrip("# "))]
    letters = "".join(_NAMES.get(w, "_") for w in words)
    if len(words) > _MOST_COLUMNS or any(letters.count(c) != 1 for c in "txyp"):
        return "", ""
    time = words[letters.index("t")]
    unit = next((u for u in ("ns", "us", "s") if time.endswith("_" + u) or units.get(time) == u), "")
    unit = "own" if text == _OWN and not units else unit
    return letters, unit


def _sensor_size(line: bytes) -> tuple[int, int]:
    """Parses the sensor's size from a line such as `t,x@640,y@480,p`."""
    found = {name.lower(): int(side) for name, side in re.findall(rb"\b([xyXY])@(\d{1,5})\b", line)}
    return found.get(b"x", 0), found.get(b"y", 0)


def _are_saved_floats(columns: str, rows: list[list[bytes]], values: list[list[float]]) -> bool:
    """Tells whether all numbers are written with a fraction of 0, and the times are not all the same."""
    place, others = columns.index("t"), [columns.index(n) for n in "xy"]
    times = {row[place] for row in values}
    fractions = all(b"." in row[i] for row in rows for i in others)
    return fractions and len(times) > 1 and all(t == int(t) for t in times)


def _columns_with_fractions(rows: list[list[bytes]]) -> list[int]:
    """Returns the columns that are written with fractions."""
    return [i for i, column in enumerate(zip(*rows)) if any(b"." in word for word in column)]


def _guess(values: list[list[float]], fractions: list[int]) -> str:
    fitting = {columns: [row for row in values if _fits(columns, row)] for columns in _ORDERS}
    times = {columns: [row[columns.index("t")] for row in rows] for columns, rows in fitting.items()}
    # an order that fits all lines before those that would leave some out
    for enough in (len(values), max(0.9 * (len(values) - 1), 1)):
        fits = [columns for columns, rows in fitting.items() if len(rows) >= enough]
        # many events of time 0 alone look like coordinates or polarities, and their rows or columns like times
        written = [c for c in fits if [c.index("t")] == fractions and _never_falls(times[c])]
        rising = [c for c in fits if times[c][0] < times[c][-1] and _never_falls(times[c])]
        for columns in (*written, *rising, *fits):
            if columns in written or columns in rising or columns in ("txyp", "xypt"):
                return columns
    return ""


def _fits(columns: str, row: list[float]) -> bool:
    sides = [row[columns.index(n)] for n in "xy"]
    return row[columns.index("p")] in (-1, 0, 1) and all(0 <= v < 65536 and v == int(v) for v in sides)


def _never_falls(times: list[float]) -> bool:
    return all(a <= b for a, b in itertools.pairwise(times))
