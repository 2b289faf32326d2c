"""Parses numbers among the arguments of commands."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def number_up_to(most: float, refusal: str, zero: bool = False) -> Callable[[str], float]:
    """Makes a type for argparse that reads a number above 0 and at most `most`.

    zero: whether 0 may be given too. refusal: what is said of another text, behind it. The function that is made raises
    ArgumentTypeError.
    """

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not (0 < value <= most or (zero and value == 0)):
            raise argparse.ArgumentTypeError(f"'{text}' {refusal}")
        return value

    return read
