"""Tells what helps a process that has come to a limit which its shell or service manager has set."""

from __future__ import annotations

import errno
import os
import resource

_PLENTY = 4096


def with_remedy(text: str) -> str:
    """Adds the limit and how to raise it to an error's text that says, from whatever library, that the process came to
    it: of open files, of the size of a file, of memory, of processes. Leaves all other texts, and those where there is
    no limit."""
    if os.strerror(errno.EMFILE) in text:
        limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        more = _PLENTY if limit < _PLENTY else 4 * limit
        return _added(text, "n", f"a process may have {limit}", str(more))
    if os.strerror(errno.EFBIG) in text:
        return _added_to_bytes(text, "f", "a file", resource.RLIMIT_FSIZE)
    if any(words in text for words in (os.strerror(errno.ENOMEM), "Unable to allocate", "Failed to allocate")):
        return _added_to_bytes(text, "v", "a process", resource.RLIMIT_AS)
    if any(words in text for words in (os.strerror(errno.EAGAIN), "can't start new thread")):
        limit = resource.getrlimit(resource.RLIMIT_NPROC)[0]
        if limit != resource.RLIM_INFINITY:
            fewer = "fewer where a container or service limits them"
            return _added(text, "u", f"a user may have {limit} processes and threads, {fewer}")
    return text


def cpu_time() -> str:
    """Tells the limit of a process's time on a CPU; "" where there is none."""
    limit = resource.getrlimit(resource.RLIMIT_CPU)[0]
    if limit == resource.RLIM_INFINITY:
        return ""
    return f"a process may have {limit} s of a CPU (ulimit -t): allow more, as by `ulimit -t unlimited`"


def _added_to_bytes(text: str, option: str, what: str, kind: int) -> str:
    limit = resource.getrlimit(kind)[0]
    return text if limit == resource.RLIM_INFINITY else _added(text, option, f"{what} may have {limit} bytes")


def _added(text: str, option: str, limit: str, more: str = "unlimited") -> str:
    ulimit = f"ulimit -{option}"
    return text if ulimit in text else f"{text}; {limit} ({ulimit}): allow more, as by `{ulimit} {more}`"
