"""Computes the data-flow order of a graph, and the cycle when there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from evis.config.document import LaunchError


def data_flow_order(names: Sequence[str], edges: Mapping[str, Sequence[tuple[str, str]]]) -> list[str]:
    """Sorts `names` so that publishers stand before their consumers, otherwise as given.

    edges: publisher -> [(consumer, topic)], lock-step only. Raises LaunchError naming the cycle and its topics.
    """
    order: list[str] = []
    state: dict[str, int] = {}
    for start in reversed(names):
        if start in state:
            continue
        path: list[tuple[str, str]] = [(start, "")]
        pending = [iter(edges.get(start, ()))]
        state[start] = 1
        while path:
            consumer, topic = next(pending[-1], ("", ""))
            if not consumer:
                name = path.pop()[0]
                pending.pop()
                state[name] = 2
                order.append(name)
            elif state.get(consumer) == 1:
                raise LaunchError(_cycle(path, consumer, topic))
            elif consumer not in state:
                state[consumer] = 1
                path.append((consumer, topic))
                pending.append(iter(edges.get(consumer, ())))
    return order[::-1]


def _cycle(path: list[tuple[str, str]], closing: str, topic: str) -> str:
    names = [name for name, _ in path]
    loop = [*path[names.index(closing) :], (closing, topic)]
    text = loop[0][0] + "".join(f" -{t}-> {name}" for name, t in loop[1:])
    return f"these nodes wait for each other for ever: {text}; declare one of these inputs `delayed`"
