"""Makes text from outside, such as names in a file, safe to show: nothing in it acts on the terminal."""

from __future__ import annotations

from typing import Any


def printable(text: object) -> str:
    r"""Returns the text with every character escaped that is not one to be seen: \x1b for ESC, \n for a new line.

    Control characters move the cursor, change colours or titles and answer as if typed; those for the direction of
    writing let a name look like another one. Letters of any language stay.
    """
    shown = str(text)
    if shown.isprintable():
        return shown
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in shown)


def printable_lines(text: object) -> str:
    """Returns a text of several lines with everything but their ends as `printable` has it."""
    return "\n".join(map(printable, str(text).split("\n")))


def all_printable(value: Any) -> Any:
    """Returns plain values (lists, maps by name, numbers) with every text in them as `printable` has it."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {all_printable(key): all_printable(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(map(all_printable, value))
    return value
