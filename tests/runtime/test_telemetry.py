"""What a process says of its nodes reaches who listens, all of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import zmq

from evis.bus import Subscriber, endpoints_for
from evis.config.secret import Redactor
from evis.runtime.hosting.wiring import system_topic
from evis.runtime.plan import Plan
from evis.runtime.profile import Profile
from evis.runtime.telemetry import Telemetry
from msgs.camera import Trigger
from msgs.codec import pack_header
from msgs.diagnostics import Diagnostics
from msgs.header import Header

NODES = [f"node{k}" for k in range(12)]


def test_nodes_of_one_process_are_all_heard_though_they_speak_at_once(tmp_path: Path) -> None:
    """Twelve heartbeats and twelve warnings in a row, to a tap at the rate of a viewer."""
    context = zmq.Context()
    telemetry = Telemetry(
        Plan("graph", "1", str(tmp_path)), "all", context, Profile(), Redactor([]), say=lambda *_: None
    )
    publisher = telemetry.publishers["/diagnostics"]
    publisher.start()
    where = endpoints_for(str(tmp_path), system_topic("/diagnostics", "all"))
    tap = Subscriber(context, "/diagnostics", "x", "tap", where, message_type=Diagnostics, tap=True)
    tap.start()
    while not publisher.wanted():
        publisher.pump()
    host: Any = SimpleNamespace(join=SimpleNamespace(queues={}), publishers={})
    telemetry.periodic(dict.fromkeys(NODES, host), force=True)
    for name in NODES:
        telemetry.say(None, name, "warning", "hot")
    heard: list[Any] = []
    while (message := tap.receive(0.3)) is not None:
        heard.append(message)
    tap.close()
    publisher.close()
    context.destroy(linger=0)
    assert [(m.node, m.level) for m in heard] == [(n, level) for level in ("ok", "warning") for n in NODES]


def test_a_warning_that_names_a_file_whose_name_is_not_utf8_is_sent() -> None:
    lines: list[str] = []
    telemetry = Telemetry(
        Plan("graph", "1", ""),
        "all",
        zmq.Context(),
        Profile(),
        Redactor([]),
        lambda name, level, text: lines.append(text),
    )
    sent: list[Any] = []
    telemetry.publishers["/diagnostics"] = SimpleNamespace(send=lambda m: sent.append(pack_header(m, {})))  # type: ignore[assignment]
    telemetry.say(None, "reader", "warning", "a\udcff.raw ends early")
    assert lines == ["a\\udcff.raw ends early"] and b"a\\udcff.raw ends early" in sent[0]


def test_the_clock_names_its_domain() -> None:
    """Two cameras have a clock each, on one topic: without its name a time could be of either."""
    profile = Profile()
    telemetry = Telemetry(Plan("graph", "1", ""), "all", zmq.Context(), profile, Redactor([]), lambda *_: None)
    sent: list[Any] = []
    telemetry.publishers["/clock"] = SimpleNamespace(wanted=lambda: True, send=sent.append)  # type: ignore[assignment]
    for name, stamp_ns, episode in (("left", 5, 0), ("right", 16 * 10**17, 2)):
        header = Header(stamp_ns, clock=f"device:{name}", episode=episode)
        profile.node(name).saw(f"/{name}/trigger", Trigger(header, *[np.empty(0, np.uint8)] * 3))
        telemetry.tick(SimpleNamespace(name=name))  # type: ignore[arg-type]
    heard = [(m.header.clock, m.header.stamp_ns, m.header.episode) for m in sent]
    assert heard == [("device:left", 5, 0), ("device:right", 16 * 10**17, 2)]
