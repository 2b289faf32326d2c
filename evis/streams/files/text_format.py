"""Which column of a text file is what, and in which unit its times are."""

from __future__ import annotations

import re
from dataclasses import dataclass

_NAMES = {
    "t": "t", "time": "t", "timestamp": "t", "timestamps": "t", "ts": "t", "t_ns": "t", "t_us": "t", "time_us": "t",
    "timestamp_us": "t", "timestamp_ns": "t", "x": "x", "y": "y",
    "p": "p", "pol": "p", "polarity": "p", "on": "p",
}  # fmt: skip
_OWN = "t,x,y,p"
"""The line of names that EVIS writes."""
_NUMBER = rb"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?"
_EVENT = re.compile(rb"\s*(%s)[ \t,;]+(%s)[ \t,;]+(%s)[ \t,;]+(%s)\s*" % ((_NUMBER,) * 4))
_SIZE = re.compile(rb"\s*(?:[#%]\s*)?(?:(?:geometry|width height|size)\s*:?\s*)?(\d{1,5})[ \t,x]+(\d{1,5})\s*", re.I)
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
    with a decimal point are seconds; whole numbers are us, but ns behind EVIS' own line of names, `t_ns`, or where they
    can be nothing else (1e17 us are 3000 years).
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
            names, size = columns, size if size != (0, 0) else _sides(line)
        elif line.strip() and not line.lstrip().startswith((b"#", b"%")):
            return None
    rows = [m for line in lines[:_LOOK] if (m := _EVENT.fullmatch(line))]
    if not rows or len(rows) < 0.9 * len([line for line in lines[:_LOOK] if line.strip()][:-1]):
        return None
    values = [[float(v) for v in row.groups()] for row in rows]
    columns = names[:4] or _guess(values)
    if not columns:
        return None
    place = columns.index("t")
    whole = all(re.fullmatch(rb"[+-]?\d+", row[place + 1]) for row in rows)
    if not whole:
        return Format(columns, 10**9, begin, size)
    if names.endswith("n") or max(abs(row[place]) for row in values) >= 1e17:
        own = names == "txypn"
        return Format(columns, 1, begin, size, "times are whole numbers: taken as ns" if own else "")
    if names.endswith("u"):
        return Format(columns, 1000, begin, size)
    return Format(columns, 1000, begin, size, "times are whole numbers: taken as us")


def _columns(line: bytes) -> str:
    """`txyp` in the order of a line of names, behind it `u` or `n` where the time is named as us or ns; else empty.

    A name may have the sensor's side behind an @.
    """
    text = line.decode("latin-1").strip()
    words = [w.strip('"').lower().partition("@")[0] for w in re.split(r"[ \t,;]+", text.lstrip("# "))]
    if len(words) != 4 or any(w not in _NAMES for w in words):
        return ""
    letters = "".join(_NAMES[w] for w in words)
    time = words[letters.index("t")] if "t" in letters else ""
    unit = "n" if time.endswith("_ns") or text == _OWN else "u" if time.endswith("_us") else ""
    return letters + unit if sorted(letters) == list("ptxy") else ""


def _sides(line: bytes) -> tuple[int, int]:
    """The sensor's size in a line such as `t,x@640,y@480,p`."""
    found = {name.lower(): int(side) for name, side in re.findall(rb"\b([xyXY])@(\d{1,5})\b", line)}
    return found.get(b"x", 0), found.get(b"y", 0)


def _guess(values: list[list[float]]) -> str:
    for columns in ("txyp", "xypt"):
        place = columns.index("p")
        if all(row[place] in (-1, 0, 1) for row in values):
            others = [row[columns.index(n)] for row in values for n in "xy"]
            if all(0 <= v < 65536 and v == int(v) for v in others):
                return columns
    return ""
