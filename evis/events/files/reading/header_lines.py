"""Finds out whether a file is cut inside the lines of text that it begins with."""

from __future__ import annotations

import re


def is_cut_line(line: bytes, begin: bytes) -> bool:
    """Tells whether the last bytes of a file are a line of its header that was cut: text that begins with `begin`, and
    no new line.

    Records can hold such bytes too, but a file of records is hardly text to its end.
    """
    return bool(re.fullmatch(re.escape(begin) + rb"[\t\r\x20-\x7e]*", line))
