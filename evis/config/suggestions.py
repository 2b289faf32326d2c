"""Suggests what a user may have meant by a name that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

CUTOFF = 0.5
"""Likeness from which on a name is suggested, 0 ... 1."""


def closest(name: str, known: Iterable[str], cutoff: float = CUTOFF) -> str | None:
    """Finds the known name that is most like `name`, None where none is alike."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return near[0] if near else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Returns `; did you mean 'x'?`, to stand behind an error, or nothing where no known name is alike."""
    near = closest(name, known)
    return f"; did you mean '{near}'?" if near else ""


def nearest(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Returns `did you mean 'x'?`, or `otherwise` and the list of what there is."""
    names = list(known)
    near = closest(name, names)
    return f"did you mean '{near}'?" if near else f"{otherwise} {', '.join(names) or 'none'}"


def environments_there(count: int) -> str:
    """Says which environments a run has, to stand behind the number of one that it has not."""
    return f"there are environments 0 to {count - 1}" if count > 1 else "there is environment 0 alone"
