"""Runs the server for Foxglove: opens the taps of what clients have subscribed to, and hands it their messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from evis.config.params import Param
from evis.runtime.node import Node

if TYPE_CHECKING:
    from evis.web.server import Server
    from evis.web.taps_on_demand import TapsOnDemand
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
    _taps: TapsOnDemand | None = None

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for an address that is not to be served with this token, or without one."""
        from evis.web.address import check_token

        check_token(params["host"], params["token"])
        return frozenset(cls.INPUTS)

    def setup(self) -> None:
        """Starts the server, and says its address."""
        from evis.web import address
        from evis.web.server import Server
        from evis.web.taps_on_demand import TapsOnDemand
        from nodes.foxglove.application import Application
        from nodes.foxglove.relay import Relay

        p = self.params
        open_to_all = p["token"] is None and address.is_loopback(p["host"])
        token = "" if open_to_all else address.choose_token(p["host"], p["token"])
        if token:
            self.hide(token)
        listener, _ = address.bind(p["host"], p["port"])
        self._relay = Relay(self.runtime.plan)
        self._taps = TapsOnDemand(self, self._relay)
        names = address.names_of(listener, [p["host"], *map(str, p["names"])])
        application = Application(self._relay, token, names, [str(origin) for origin in p["origins"]])
        self._server = Server(application, self._relay, listener)
        self._server.start()
        # A token may serve again, and what the user sees may be kept in a file.
        shown = f"ws://{address.place(listener)}{'/...' if token else ''}"
        self.tell(f"open {shown} in Foxglove or Lichtblick (Foxglove WebSocket)")

    def idle(self) -> None:
        """Opens and closes taps as subscriptions come and go, and counts and warns for the server."""
        if self._relay is None or self._taps is None:
            return
        for topic, count in self._taps.lost():
            self._relay.miss(topic, count)
        self._taps.update()
        self._relay.tick()
        for text in self._relay.reports():
            self.warn(text)
        for name, amount in self._relay.counts().items():
            if amount:
                self.count(name, amount)

    def finish(self) -> None:
        """Notes for the clients what ended the graph, where that was a failure."""
        if self._relay is not None:
            self._relay.failure = self.runtime.failure

    def close(self) -> None:
        """Closes the taps and ends the server."""
        if self._taps is not None:
            self._taps.close()
        if self._server is not None:
            self._server.stop()
