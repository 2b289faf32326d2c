"""Runs the server for Foxglove: opens the taps of what clients have subscribed to, and hands it their messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from evis.config.params import Param
from evis.runtime.node import Node

if TYPE_CHECKING:
    from evis.runtime.tap import TapSubscription
    from evis.web.server import Server
    from nodes.foxglove.relay import Relay

DEFAULT_PORT = 8765
"""That of all bridges to Foxglove: its dialog proposes it."""


class FoxgloveNode(Node):
    """Serves the graph's topics to Foxglove and Lichtblick. Reads nothing until somebody subscribes to it."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "host": Param(str, "127.0.0.1", "address to listen on; beyond loopback a token must be given"),
        "port": Param(int, DEFAULT_PORT, "port to listen on, 0 = any free one", minimum=0, maximum=65535),
        "token": Param(
            str, None, "secret at the end of the address, ws://HOST:PORT/TOKEN; as env:NAME or file:PATH it does not "
            "stand on the command line, which every user of the machine can read (ps)", optional=True, secret=True,
        ),
        "names": Param(
            list, [], "names besides localhost and the address under which a client may ask for the graph, such as a "
            "proxy's; one of another name gets nothing (DNS rebinding)",
        ),
        "origins": Param(
            list, [], "origins, such as https://lichtblick.example.org, of pages that may read the graph besides those "
            "of foxglove.dev and of this machine",
        ),
    }  # fmt: skip

    _relay: Relay | None = None
    _server: Server | None = None

    def setup(self) -> None:
        """Starts the server, and says its address."""
        from evis.web import address
        from evis.web.server import Server
        from nodes.foxglove.application import Application
        from nodes.foxglove.relay import Relay

        p = self.params
        open_to_all = p["token"] is None and address.is_loopback(p["host"])
        token = "" if open_to_all else address.choose_token(p["host"], p["token"])
        if token:
            self.hide(token)
        listener, _ = address.bind(p["host"], p["port"])
        self._taps: dict[str, TapSubscription] = {}
        self._lost: dict[str, int] = {}
        self._relay = Relay(self.runtime.plan)
        names = address.names_of(listener, [p["host"], *map(str, p["names"])])
        application = Application(self._relay, token, names, [str(origin) for origin in p["origins"]])
        self._server = Server(application, self._relay, listener)
        self._server.start()
        # A token may serve again, and what the user sees may be kept in a file.
        shown = f"ws://{address.place(listener)}{'/...' if token else ''}"
        self.tell(f"open {shown} in Foxglove or Lichtblick (Foxglove WebSocket)")

    def idle(self) -> None:
        """Opens and closes taps as subscriptions come and go, and counts and warns for the server."""
        if self._relay is None:
            return
        wanted = self._relay.wanted()
        for topic, tap in list(self._taps.items()):
            lost, before = tap.lost, self._lost.get(topic, 0)
            if lost > before:
                self._lost[topic] = lost
                self._relay.miss(topic, lost - before)
            if topic not in wanted:
                self._taps.pop(topic).close()
                self._lost.pop(topic, None)
                self._relay.forget(topic)
        for topic in wanted - self._taps.keys():
            if not self._relay.refused(topic):
                self._open(self._relay, topic)
        self._relay.tick()
        for text in self._relay.reports():
            self.warn(text)
        for name, amount in self._relay.counts().items():
            if amount:
                self.count(name, amount)

    def _open(self, relay: Relay, topic: str) -> None:
        plan = self.runtime.plan
        publisher = plan.nodes.get(plan.topics[topic].node) if topic in plan.topics else None
        try:
            self._taps[topic] = self.runtime.open_tap(self, topic, lambda message: relay.put(topic, message))
            if publisher is not None and publisher.dormant:
                self.runtime.request(topic)
        except (ValueError, OSError) as error:
            relay.refuse(topic, str(error))

    def finish(self) -> None:
        """Notes for the clients what ended the graph, where that was a failure."""
        if self._relay is not None:
            self._relay.failure = self.runtime.failure

    def close(self) -> None:
        """Closes the taps and ends the server."""
        for tap in getattr(self, "_taps", {}).values():
            tap.close()
        self._taps = {}
        if self._server is not None:
            self._server.stop()
