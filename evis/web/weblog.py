"""Takes what the web server's libraries log: one short line each to the node, never a traceback; junk is counted."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterator
from typing import Any

from aiohttp import http_exceptions

LONGEST = 200
"""Longest line [characters]."""
_LOGGERS = ("aiohttp", "asyncio")


class WebLog(logging.Handler):
    """Handles the libraries' log records.

    report: takes one line, and says it as often as is good. refused: called for each request that is no HTTP.
    """

    def __init__(self, report: Callable[[str], None], refused: Callable[[], None]) -> None:
        super().__init__()
        self._report = report
        self._refused = refused
        self.logger = logging.Logger("evis.web")
        self.logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Takes one record of a logger."""
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, http_exceptions.HttpProcessingError):
            self._refused()
            self._report("requests come that are no HTTP; they are refused and counted")
            return
        if record.levelno < logging.WARNING:
            return
        with contextlib.suppress(Exception):  # a log of a fault is no reason for another
            self._say(record.getMessage(), error)

    def fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Takes what an event loop has to say."""
        self._say(str(context.get("message", "")), context.get("exception"))

    def _say(self, text: str, error: BaseException | None) -> None:
        why = f": {type(error).__name__}: {error}" if error is not None else ""
        line = " ".join(f"web server: {text}{why}".split())[:LONGEST]
        self._report("".join(letter if " " <= letter <= "~" else "?" for letter in line))

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Takes what the libraries log within the block; it goes nowhere else."""
        found = [logging.getLogger(name) for name in _LOGGERS]
        before = [logger.propagate for logger in found]
        for logger in found:
            logger.addHandler(self)
            logger.propagate = False
        try:
            yield
        finally:
            for logger, propagate in zip(found, before):
                logger.removeHandler(self)
                logger.propagate = propagate
