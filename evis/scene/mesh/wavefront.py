"""Texts of OBJ and MTL: their encoding, and what stands before a picture: `map_Kd -s 2 2 1 -o 0.5 0 0 wood.png`."""

from __future__ import annotations

import numpy as np

_MOST = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""Most words after an option; the others have one."""


def file_of(text: str) -> str:
    """Returns the file's name of a text that may begin with options."""
    return _taken_apart(text)[0]


def layout_of(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns by what texture coordinates are multiplied, and what is added then, float64 [2] each."""
    options = _taken_apart(text)[1]
    found = []
    for key, default in (("-s", 1.0), ("-o", 0.0)):
        numbers = [float(word) for word in options.get(key, ())][:2]
        found.append(np.array(numbers + [default] * (2 - len(numbers))))
    return found[0], found[1]


def in_utf8(content: bytes) -> bytes:
    """Returns a text that is UTF-8, from one that is that or Latin-1."""
    try:
        content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1").encode()
    return content


def _taken_apart(text: str) -> tuple[str, dict[str, list[str]]]:
    words, options = text.split(), dict[str, list[str]]()
    while len(words) > 2 and words[0].startswith("-"):
        key, count = words[0], 1
        if key in _MOST:
            count = next((n for n in range(_MOST[key]) if not _is_number(words[1 + n])), _MOST[key])
        count = min(count, len(words) - 2)
        options[key], words = words[1 : 1 + count], words[1 + count :]
    return (" ".join(words) if options else text), options


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
