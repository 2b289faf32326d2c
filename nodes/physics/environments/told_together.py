"""Groups warnings of environments by their text, to tell each once."""

from __future__ import annotations

import re
from collections.abc import Sequence

NAMED = 8
"""Environments that a line names, of those that it is about."""
_NUMBER = re.compile(r"[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?")


def told_together(found: Sequence[tuple[int, str]]) -> list[tuple[list[int], str]]:
    """Returns environments and a line for each kind of line that they have: those that differ in numbers alone are of
    one kind, and the first of them is told.

    found: (environment, line), as they were found.
    """
    kinds: dict[str, list[tuple[int, str]]] = {}
    for env, text in found:
        kinds.setdefault(_NUMBER.sub("#", text), []).append((env, text))
    lines = []
    for some in kinds.values():
        env, text = some[0]
        others = "" if all(other == text for _, other in some) else f" (of environment {env}; others differ in numbers)"
        lines.append((list(dict.fromkeys(env for env, _ in some)), text + others))
    return lines


def named(envs: Sequence[int]) -> str:
    """Names environments: `environment 3`, `environments 0, 1, 2`, `environments 0, 1, ... (64)`."""
    if len(envs) == 1:
        return f"environment {envs[0]}"
    first = ", ".join(map(str, envs[:NAMED]))
    return f"environments {first}, ... ({len(envs)})" if len(envs) > NAMED else f"environments {first}"
