"""Asks the nodes of a graph that runs whether environments may begin anew with other seeds."""

from __future__ import annotations

from collections.abc import Mapping

from evis.runtime.hosting.wiring import load_class
from evis.runtime.plan import Plan


def check_seeds(plan: Plan, source: str, seeds: Mapping[int, int]) -> None:
    """Checks that all nodes that work on what a source publishes can go on with other seeds of its environments.

    They find out from their parameters alone, wherever they run, so that nothing has happened yet where one cannot.

    Args:
        plan: of the graph.
        source: the node that is to reset environments.
        seeds: environment -> its seed from now on.

    Raises ValueError in one line.
    """
    for node in plan.downstream(source):
        if node.refuses and not node.dormant:
            cls, wanted = load_class(node.target), frozenset(node.outputs)
            for env, seed in seeds.items():
                try:
                    cls.check_seed(node.params, wanted, env, seed)
                except ValueError as error:
                    raise ValueError(f"environment {env} cannot begin anew with seed {seed}: {error}") from None
