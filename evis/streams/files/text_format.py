"""Which column of a text file is what, and in which unit its times are."""

from __future__ import annotations

import re
from dataclasses import dataclass

_NAMES = {
    "t": "t", "time": "t", "timestamp": "t", "ts": "t", "t_ns": "t", "t_us": "t", "x": "x", "y": "y",
    "p": "p", "pol": "p", "polarity": "p", "on": "p",
}  # fmt: skip
_NUMBER = rb"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?"
_EVENT = re.compile(rb"\s*(%s)[ \t,;]+(%s)[ \t,;]+(%s)[ \t,;]+(%s)\s*" % ((_NUMBER,) * 4))
_SIZE = re.compile(rb"\s*(\d{1,5})[ \t,]+(\d{1,5})\s*")
_LOOK = 64


@dataclass(frozen=True)
class Format:
    """columns: what each column is. unit: ns of one unit of time. begin: byte of the first event."""

    columns: str
    unit: int
    begin: int
    size: tuple[int, int] = (0, 0)
    assumed: str = ""

    @property
    def name(self) -> str:
        """As in the encoding of `RecordingInfo`."""
        return f"{self.columns}, t in {({1: 'ns', 1000: 'us', 10**9: 's'})[self.unit]}"

    @property
    def time_last(self) -> bool:
        """A cut line can then be a shorter number."""
        return self.columns[-1] != "p"


def find_format(head: bytes) -> Format | None:
    """The format of a file with this beginning; None where it is not events as text.

    Without names of columns, polarity is the one that is -1, 0 or 1; behind it may come the time (`x,y,p,t`). Times
    with a decimal point are seconds; whole numbers are us, but behind a line of names ns (as EVIS writes it), unless
    the name is `t_us`.
    """
    if b"\0" in head:
        return None
    lines, begin, names, size = head.split(b"\n"), 0, "", (0, 0)
    if len(lines) > 1 and len(head) >= 4096:
        lines.pop()  # may be cut
    while lines and not _EVENT.fullmatch(lines[0]):
        line = lines.pop(0)
        begin += len(line) + 1
        found = _SIZE.fullmatch(line)
        if found and size == (0, 0):
            size = int(found[1]), int(found[2])
        elif (columns := _columns(line)) and not names:
            names = columns
        elif line.strip() and not line.lstrip().startswith((b"#", b"%")):
            return None
    rows = [m for line in lines[:_LOOK] if (m := _EVENT.fullmatch(line))]
    if not rows or len(rows) < 0.9 * len([line for line in lines[:_LOOK] if line.strip()][:-1]):
        return None
    values = [[float(v) for v in row.groups()] for row in rows]
    columns = names.rstrip("u") or _guess(values)
    if not columns:
        return None
    place = columns.index("t")
    whole = all(re.fullmatch(rb"[+-]?\d+", row[place + 1]) for row in rows)
    if not whole:
        return Format(columns, 10**9, begin, size)
    if names:
        in_us = names.endswith("u")
        return Format(
            columns, 1000 if in_us else 1, begin, size, "" if in_us else "times are whole numbers: taken as ns"
        )
    return Format(columns, 1000, begin, size, "times are whole numbers: taken as us")


def _columns(line: bytes) -> str:
    """`txyp` in the order of a header line, a `u` behind it where the time is named as us; empty if it is none."""
    words = [w.strip().strip('"').lower() for w in re.split(r"[ \t,;]+", line.decode("latin-1").strip().lstrip("# "))]
    if len(words) != 4 or any(w not in _NAMES for w in words):
        return ""
    letters = "".join(_NAMES[w] for w in words)
    return letters + ("u" if "t_us" in words else "") if sorted(letters) == list("ptxy") else ""


def _guess(values: list[list[float]]) -> str:
    for columns in ("txyp", "xypt"):
        place = columns.index("p")
        if all(row[place] in (-1, 0, 1) for row in values):
            others = [row[columns.index(n)] for row in values for n in "xy"]
            if all(0 <= v < 65536 and v == int(v) for v in others):
                return columns
    return ""
