"""Runs one process of a running graph: `python -m evis.runtime.process [--early] PLAN.json PROCESS`.

The supervisor starts it; with --early before there is a plan, which exists once standard input ends.
"""

from __future__ import annotations

import contextlib
import gc
import resource
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any

from evis.config.secret import Redactor, Veil
from evis.console.outlet import standard_streams
from evis.console.termination import STATUS, Termination
from evis.runtime.executor import Executor
from evis.runtime.hosting.node_call import NodeFailed, describe
from evis.runtime.plan import Plan
from evis.runtime.process.control import ControlClient, control_address
from evis.runtime.process.garbage_collection import without_garbage_collection
from evis.runtime.process.parent_death import die_with_parent
from evis.runtime.process.thread_failures import ThreadFailures
from evis.warp_start import start_warp

BARRIER_S = 1800.0
"""Longest wait for the other processes [s]: their setup may compile kernels for the first time, minutes on a small
machine. One that dies meanwhile is the supervisor's to notice."""

SWITCH_S = 2e-4
"""Time after which a thread gives way to one that waits for Python's interpreter [s]: nodes give it up at each of their
many short calls of a device, and waited for a recorder's threads up to 5 ms each time."""


def main(argv: list[str]) -> int:
    """Runs the nodes of one process. Exit status 0, 1 after a failure that was reported, 143 when told to end."""
    with standard_streams():  # a log that has no room must not end a node
        return _main(argv)


def _main(argv: list[str]) -> int:
    *early, plan_path, process = argv
    die_with_parent()
    sys.setswitchinterval(SWITCH_S)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C is the supervisor's to handle, in order
    if early and not _plan_comes(Path(plan_path)):
        return 0
    termination = Termination()
    plan = Plan.load(Path(plan_path))
    hide = Redactor(plan.secrets)
    sys.stdout, sys.stderr = Veil(sys.stdout, hide), Veil(sys.stderr, hide)  # type: ignore[assignment]
    control = ControlClient(control_address(plan.directory), process)
    executor = None
    threads = ThreadFailures(process)
    threading.excepthook = threads.note
    try:
        with without_garbage_collection():
            executor = Executor(plan, process, request=control.want, tell=control.tell, redactor=hide)
            try:
                executor.setup()
            except Exception:
                with contextlib.suppress(NodeFailed):  # what went wrong first is told
                    executor.close_nodes()
                raise
        _run(executor, control, termination, threads)
        return 0
    except Exception as error:
        cause = error.__cause__ if isinstance(error, NodeFailed) and error.__cause__ else error
        traceback.print_exception(cause)
        if termination.asked:
            return STATUS  # it was broken off in the middle of something: that is no failure of the node's
        node = error.node if isinstance(error, NodeFailed) else process
        control.failed(node, hide.text(describe(cause)))
        return 1
    finally:
        if executor is not None:
            executor.close()
        control.close()


def _plan_comes(path: Path) -> bool:
    """Starts Warp, and waits for the plan; False where none will come."""
    with contextlib.suppress(Exception):  # the node that needs it says what is wrong
        start_warp()
    sys.stdin.buffer.read()
    return path.exists()


def _run(executor: Executor, control: ControlClient, termination: Termination, threads: ThreadFailures) -> None:
    def commands() -> None:
        termination.check()
        threads.check()
        for command in control.poll():
            if "stop" in command:
                executor.failure = str(command.get("cause") or "")
                executor.stop()
        control.heartbeat(executor.progress())

    executor.wait_connected(BARRIER_S, commands)
    if not executor.stopping:
        control.ready()
        if not control.wait_go(termination.check):
            executor.stop()
    gc.freeze()  # what setup made stays: the collector need not look through it again and again
    before = time.process_time()
    executor.run(commands)
    threads.check()
    control.done(
        {"nodes": executor.summary(), "rss_mb": _peak_rss_mb(), "cpu_s": round(time.process_time() - before, 6)}
    )


def _peak_rss_mb() -> float:
    """Returns the largest resident memory of this process [MB]; ru_maxrss is in kB on Linux, in bytes on macOS."""
    peak: Any = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1e6 if sys.platform == "darwin" else 1e3), 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
