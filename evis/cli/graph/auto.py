"""`interpolator:=auto` on the command line: the choice, with what is being measured shown on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from evis.console.printable import printable

if TYPE_CHECKING:
    from evis.launch.files import LaunchFile
    from evis.launch.planner import Options


def replace_auto(
    launch: LaunchFile, given: Mapping[str, Any], options: Options
) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """The arguments with auto replaced, what was chosen, and those given arguments that must have an effect.

    Raises ValueError where the scene cannot be measured or a wish makes no sense.
    """
    from nodes.interpolator.auto import launch as auto

    def warn(line: str) -> None:
        print(f"interpolator auto: {printable(line)}", file=sys.stderr)

    with told() as say:
        taken, chosen = auto.replace_auto(launch, given, options, say, warn)
    # What is only for some methods was given for the case that one of them is chosen.
    return taken, chosen, [key for key in taken if key not in (*auto.WARP, "adaptive_px")]


@contextmanager
def told() -> Iterator[Callable[[str], None]]:
    """Shows on a terminal what is being measured, and for how long, in a line that is gone afterwards."""
    shown, began = sys.stderr.isatty(), time.monotonic()

    def say(line: str) -> None:
        if shown:
            spent = f"{time.monotonic() - began:.0f} s"
            print(
                f"\r\033[Kinterpolator auto, measuring, {spent}: {printable(line)}", end="", file=sys.stderr, flush=True
            )

    try:
        yield say
    finally:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
