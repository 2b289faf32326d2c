"""Fixtures: a node that serves a made-up graph, and clients of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from foxglove_node import Foxglove, Served, make_plan


@pytest.fixture
def serve() -> Iterator[Callable[..., Served]]:
    """Serves a graph: serve(plan, **parameters)."""
    made: list[Served] = []

    def make(plan: Any = None, **params: Any) -> Served:
        made.append(Served(plan or make_plan(), **params))
        return made[-1]

    yield make
    for one in made:
        one.node.close()


@pytest.fixture
def served(serve: Callable[..., Served]) -> Served:
    return serve()


@pytest.fixture
def client(served: Served) -> Iterator[Foxglove]:
    with Foxglove(served.address) as one:
        yield one
