"""Tells what helps a process that may open no more files."""

from __future__ import annotations

import errno
import os
import resource

_PLENTY = 4096


def with_remedy(text: str) -> str:
    """Adds the limit and how to raise it to an error's text that says, from whatever library, that too many files are
    open."""
    if os.strerror(errno.EMFILE) not in text or "ulimit -n" in text:
        return text
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    more = _PLENTY if limit < _PLENTY else 4 * limit
    return f"{text}; a process may have {limit} (ulimit -n): allow more, as by `ulimit -n {more}`"
