"""What the actions on files share: the output's arguments, and progress on a terminal."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evis.streams import Events, Recording


def add_output(parser: argparse.ArgumentParser) -> None:
    """OUT and --encoding."""
    parser.add_argument("out", metavar="OUT", help="a file to write: .raw, .npz, .csv or .txt")
    parser.add_argument("--encoding", default="", choices=["evt2", "evt3"], help="of a .raw file (evt3)")


def is_raw(path: str) -> bool:
    """Whether a file by this name is written as RAW."""
    return path.lower().endswith(".raw")


def rounded(events: Events) -> int:
    """Events whose time RAW rounds, as it holds whole us."""
    return int((events.t % 1000 != 0).sum())


@contextmanager
def percent(recording: Recording, text: str) -> Iterator[Callable[[], None]]:
    """A progress bar over a file, on a terminal only; call what it gives after each block."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from tqdm import tqdm

    with tqdm(total=100, desc=text, unit="%", leave=False, file=sys.stderr) as bar:
        yield lambda: bar.update(int(100 * recording.position) - bar.n) and None


@contextmanager
def counted(total: int | None, text: str) -> Iterator[Callable[[int], None]]:
    """A progress bar over frames, on a terminal only; call what it gives with the number of new ones."""
    if not sys.stderr.isatty():
        yield lambda n: None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=text, unit=" frames", leave=False, file=sys.stderr) as bar:
        yield lambda n: bar.update(n) and None
