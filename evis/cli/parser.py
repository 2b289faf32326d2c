"""The argument parser of all commands: one line for an error, the example at the end of the help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from evis.printable import printable


class UsageError(ValueError):
    """A command line that is understood but wrong: exit status 2."""


class Parser(argparse.ArgumentParser):
    """`words`: the command line, for a help text that depends on it."""

    def __init__(
        self, prog: str = "", description: str = "", epilog: str = "", words: Sequence[str] = (), **kwargs: Any
    ) -> None:
        kwargs.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(prog=prog, description=description, epilog=epilog, allow_abbrev=False, **kwargs)
        self.words = list(words)

    def error(self, message: str) -> NoReturn:
        """One line, and exit status 2."""
        print(f"{self.prog}: {printable(message)} ({self.prog} --help tells more)", file=sys.stderr)
        raise SystemExit(2)
