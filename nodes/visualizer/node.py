"""Runs the visualizer: opens the taps that the page's panels ask for, and hands their messages to its server."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from evis.config.params import Param
from evis.runtime.node import Node

if TYPE_CHECKING:
    from evis.web.server import Server
    from evis.web.taps_on_demand import TapsOnDemand
    from nodes.visualizer.hub import Hub


class VisualizerNode(Node):
    """Serves the live page. Reads nothing until somebody looks, and then only what is looked at."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "host": Param(str, "127.0.0.1", "address to listen on; beyond loopback a token must be given"),
        "port": Param(
            int, None, "port of the page, 0 = any free one; default 8421 or the next free one",
            minimum=0, maximum=65535, optional=True,
        ),
        "token": Param(
            str, None, "secret in the page's address; random unless given; as env:NAME or file:PATH it does not "
            "stand on the command line, which every user of the machine can read (ps)", optional=True, secret=True,
        ),
        "names": Param(
            list, [], "names besides localhost and the address under which a browser may ask for the page, such as a "
            "proxy's; a page of another name gets nothing (DNS rebinding)",
        ),
        "listener": Param(str, None, "path at which `evis view` lends the page's socket", optional=True),
        "max_fps": Param(float, 30.0, "most bundles per second to each browser", "Hz", minimum=1, maximum=120),
        "jpeg_quality": Param(int, 80, "quality of photographs on the page", minimum=10, maximum=95),
    }  # fmt: skip

    _hub: Hub | None = None
    _server: Server | None = None
    _taps: TapsOnDemand | None = None
    _address_file: Path | None = None

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for an address that is not to be served with this token, or without one."""
        from evis.web.address import check_token

        check_token(params["host"], params["token"])
        return frozenset(cls.INPUTS)

    def setup(self) -> None:
        """Starts the page's server, and writes its address where `evis view` finds it."""
        from evis.web import address
        from evis.web.server import Server
        from evis.web.taps_on_demand import TapsOnDemand
        from nodes.visualizer.application import Application
        from nodes.visualizer.hub import Hub
        from nodes.visualizer.socket_lender import borrow

        p, plan = self.params, self.runtime.plan
        token = address.choose_token(p["host"], p["token"])
        self.hide(token)
        listener, note = (borrow(p["listener"]), "") if p["listener"] else address.bind(p["host"], p["port"])
        self._hub = Hub(plan, p["jpeg_quality"])
        self._taps = TapsOnDemand(self, self._hub)
        names = address.names_of(listener, [p["host"], *map(str, p["names"])])
        self._server = Server(Application(self._hub, token, names, p["max_fps"]), self._hub, listener)
        self._server.start()
        url = address.url(listener, token)
        self._address_file = Path(plan.directory) / "viewer.json"
        write_private(self._address_file, {"url": url, "pid": os.getpid()})
        if not p["listener"]:  # who lends a socket has said where the page is
            # A token that somebody chose may serve again, and what the user sees may be kept in a file.
            shown = url if p["token"] is None else address.url(listener, "...")
            self.tell(f"open {shown}" + (f" ({note})" if note else ""))

    def idle(self) -> None:
        """Opens and closes taps as panels open and close, and counts and warns for the server."""
        if self._hub is None or self._taps is None:
            return
        self._taps.update()
        for text in self._hub.reports():
            self.warn(text)
        for name, amount in self._hub.counts().items():
            self.count(name, amount)

    def finish(self) -> None:
        """Tells the page that the graph has ended, and what ended it where that was a failure."""
        if self._hub is not None:
            self._hub.finish(self.runtime.failure)

    def close(self) -> None:
        """Closes the taps and ends the server."""
        if self._taps is not None:
            self._taps.close()
        if self._server is not None:
            self._server.stop()
        if self._address_file is not None:
            with contextlib.suppress(OSError):
                self._address_file.unlink()


def write_private(path: Path, content: dict[str, Any]) -> None:
    """Writes JSON that only this user can read, in one step."""
    temporary = path.with_suffix(".tmp")
    with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
        json.dump(content, file)
    temporary.replace(path)
