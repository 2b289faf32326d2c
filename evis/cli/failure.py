"""Shows an error to the user: one line, and the exit status."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable

from evis.console.printable import printable, printable_lines
from evis.console.process_limits import with_remedy
from evis.console.working_folder import REMOVED, is_of_removed

READER_GONE = 128 + signal.SIGPIPE
"""Exit status when the work is done but whoever was to read standard output had gone: 141, as shells have it."""


def guarded(who: str, debug: bool, action: Callable[[], int]) -> int:
    """Runs `action` and turns what it raises into an exit status and one line on stderr.

    A BrokenPipeError of standard output is the end of a stream whose reader has had enough, as `head` has, and no
    failure. KeyboardInterrupt: its argument is the signal, SIGINT if it has none.
    """
    from evis.cli.parser import UsageError
    from evis.config.paths import UnknownLaunch
    from evis.console.outlet import standard_streams

    with standard_streams() as (out, _):
        try:
            status = action()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except (UsageError, UnknownLaunch) as error:
            status = _told(who, one_line(error), 2)
        except KeyboardInterrupt as stop:
            status = _told(who, "interrupted", 128 + (stop.args[0] if stop.args else signal.SIGINT))
        except Exception as error:
            if isinstance(error, BrokenPipeError) and error is out.error:
                return 0
            if debug:
                print(printable_lines(traceback.format_exc().rstrip("\n")), file=sys.stderr)
            status = _told(who, one_line(error), 1)
        out.flush()
        if isinstance(out.error, BrokenPipeError):
            status = status or READER_GONE
        elif out.error is not None:
            where = f" and is in {out.kept_in}" if out.kept_in else ""
            status = _told(who, f"{out.reason}; what was to be read there is not complete{where}", status or 1)
        return status


def _told(who: str, text: str, status: int) -> int:
    print(f"{who}: {printable(text)}", file=sys.stderr)
    return status


def one_line(error: BaseException) -> str:
    """Describes an exception in one line for a person; names its type only where the text alone would not do."""
    if is_of_removed(error):
        return REMOVED
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return with_remedy(f"{error.filename}: {error.strerror}")
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    text = with_remedy(" ".join(text.split()))
    if isinstance(error, ModuleNotFoundError):
        return f"{text}; install evis again"
    if isinstance(error, (ValueError, OSError, KeyError)) and text:
        return text
    from evis.cli.parser import UsageError
    from evis.runtime.hosting.node_call import NodeFailed

    if isinstance(error, UsageError):
        return text
    if isinstance(error, NodeFailed):  # its text names the node, and the type of the cause where that is needed
        known = isinstance(error.__cause__, (ValueError, OSError, KeyError))
        return text if known else f"{text} (--debug shows the traceback)"
    return f"{type(error).__name__}: {text} (--debug shows the traceback)"
