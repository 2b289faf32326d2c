"""Finds which of several failures was the cause, and words it for the user."""

from __future__ import annotations

import signal
from collections.abc import Iterable

from evis.supervisor.child import Child

_PEER_LOST = "(topic /"
"""Text of the bus where the other end of a topic is gone: a consequence, as long as there is another cause."""
_LINES = 12
_STUCK_S = 2.0
"""A process whose loop has not come round for so long is in one step; one that waits for others comes round [s]."""


def describe_failure(child: Child) -> str:
    """Describes a failure in one line: what the node said, or how the process died."""
    if child.failure is None:
        return child.unannounced_exit()
    node, text = child.failure
    return text if text.startswith(f"{node}: ") else f"{node}: {text}"


def first_cause(children: Iterable[Child]) -> Child:
    """Finds the cause among failures: a death without a report comes before a report, and both before "my neighbour is
    gone".

    One that was told to end by SIGTERM comes after who reports something, and before its neighbours.
    """
    failed = list(children)
    silent = [c for c in failed if c.failure is None]
    deaths = [c for c in silent if c.exit_status not in (143, -signal.SIGTERM)]
    reports = [c for c in failed if c.failure and _PEER_LOST not in c.failure[1]]
    return (deaths or reports or silent or failed)[0]


def cause_unheard(children: Iterable[Child]) -> bool:
    """Tells whether all failures so far report a lost neighbour, so that the neighbour's own is still to come."""
    return all(c.failure is not None and _PEER_LOST in c.failure[1] for c in children)


def ended_by_force(children: Iterable[Child], patience_s: float, asked: bool) -> str:
    """Describes in one line processes that had to be killed at the end.

    asked: by a second Ctrl-C, and not for waiting. Who is in one step all the while is named before those that wait
    for it.
    """
    found = list(children)
    stuck = [c for c in found if c.busy_s > _STUCK_S] or found
    names = ", ".join(c.title for c in stuck)
    was = "was" if len(stuck) == 1 else "were"
    waited = ", ".join(c.title for c in found if c not in stuck)
    where = f" of {stuck[0].where}" if len(stuck) == 1 and stuck[0].where else ""
    longest = max(c.busy_s for c in stuck)
    why = f" (in one step{where} for {longest:.0f} s)" if stuck[0].busy_s > _STUCK_S else ""
    so = "so was" if len(stuck) + 1 == len(found) else "so were"
    rest = f", and {so} {waited}, which waited for {'it' if was == 'was' else 'them'}" if waited else ""
    end = f"{was} ended by force{', as a second Ctrl-C asks' * asked}{rest}; {'its' if len(found) == 1 else 'their'}"
    late = "" if asked else f"did not end in {patience_s:g} s and "
    return f"{names}{why} {late}{end} files may be incomplete"


def last_words(child: Child) -> list[str]:
    """Returns the end of a child's log without tracebacks."""
    lines = [line for line in child.last_lines(_LINES) if not line.startswith(("Traceback (", "  "))]
    return [f"  {child.name} | {line}" for line in lines]
