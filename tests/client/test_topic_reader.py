"""A program that reads a topic of a graph, some of whose processes are not there."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import zmq

from evis.bus import Publisher, endpoints_for
from evis.client.topics import TopicReader
from evis.runtime.hosting.wiring import system_topic
from evis.runtime.plan import NodePlan, Plan
from msgs.diagnostics import Diagnostics

LIMIT_S = 30.0


def test_a_process_that_starts_on_demand_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages that come meanwhile would be taken for ones that came late, and all at once."""
    monkeypatch.setattr("evis.client.topics._CONNECTION_S", LIMIT_S)
    nodes = {name: NodePlan(name, "a:B", {}, name, dormant=name == "later") for name in ("now", "later")}
    context = zmq.Context()
    where = endpoints_for(str(tmp_path), system_topic("/diagnostics", "now"))
    publisher = Publisher(context, "/diagnostics", "now", where, [], message_type=Diagnostics)
    publisher.start()
    start = time.monotonic()
    with TopicReader(Plan("graph", "1", str(tmp_path), nodes=nodes), "/diagnostics"):
        waited_s = time.monotonic() - start
    publisher.close()
    context.destroy(linger=0)
    assert waited_s < LIMIT_S
