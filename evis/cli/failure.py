"""What an error looks like to the user: one line, and the exit status."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable

from evis.printable import printable, printable_lines


def guarded(who: str, debug: bool, action: Callable[[], int]) -> int:
    """Run `action` and turn what it raises into an exit status and one line on stderr."""
    from evis.cli.parser import UsageError
    from evis.paths import UnknownLaunch

    try:
        status = action()
        sys.stdout.flush()
        return status
    except (UsageError, UnknownLaunch) as error:
        print(f"{who}: {printable(one_line(error))}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader of a pipe has had enough, as `head` does; nothing more may be written at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print(f"{who}: interrupted", file=sys.stderr)
        return 1
    except Exception as error:
        if debug:
            print(printable_lines(traceback.format_exc().rstrip("\n")), file=sys.stderr)
        print(f"{who}: {printable(one_line(error))}", file=sys.stderr)
        return 1


def one_line(error: BaseException) -> str:
    """An exception as one line for a person; the type is named only where the text alone would not do."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    text = " ".join(text.split())
    if isinstance(error, ModuleNotFoundError):
        return f"{text}; install evis again"
    if isinstance(error, (ValueError, OSError, KeyError)) and text:
        return text
    from evis.cli.parser import UsageError

    if isinstance(error, UsageError):
        return text
    return f"{type(error).__name__}: {text} (--debug shows the traceback)"
