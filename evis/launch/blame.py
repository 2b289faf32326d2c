"""Which of several failures was the cause, and how to say it."""

from __future__ import annotations

from collections.abc import Iterable

from evis.launch.child import Child

_PEER_LOST = "(topic /"
"""What the bus writes when the other end of a topic is gone: a consequence, as long as there is a cause."""
_LINES = 12


def why(child: Child) -> str:
    """One line about a failure: what the node said, or how the process died."""
    return f"{child.failure[0]}: {child.failure[1]}" if child.failure else child.death()


def first_cause(children: Iterable[Child]) -> Child:
    """Of those that failed: a death without a word before a report, a report before "my neighbour is gone"."""
    failed = list(children)
    deaths = [c for c in failed if c.failure is None]
    reports = [c for c in failed if c.failure and _PEER_LOST not in c.failure[1]]
    return (deaths or reports or failed)[0]


def by_force(children: Iterable[Child], patience_s: float) -> str:
    """One line about processes that had to be killed at the end."""
    names = ", ".join(c.title for c in children)
    return f"{names} did not end in {patience_s:g} s and was ended by force; its files may be incomplete"


def last_words(child: Child) -> list[str]:
    """The end of its log without tracebacks."""
    lines = [line for line in child.last_lines(_LINES) if not line.startswith(("Traceback (", "  "))]
    return [f"  {child.name} | {line}" for line in lines]
