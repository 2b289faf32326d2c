"""Lends the page's listening socket to the visualizers of one graph after another: `evis view` keeps it meanwhile."""

from __future__ import annotations

import contextlib
import shutil
import socket
import tempfile
import threading
from pathlib import Path


class SocketLender:
    """Hands a listening socket to the visualizers of one graph after another.

    Whoever connects while no graph runs waits for the next one, instead of being refused.
    """

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._folder = tempfile.mkdtemp(prefix="evis-view-")  # readable by this user alone
        self.path = str(Path(self._folder) / "page")
        self._lending = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._lending.bind(self.path)
        self._lending.listen()
        threading.Thread(target=self._serve, name="lender", daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                peer, _ = self._lending.accept()
            except OSError:
                return
            with peer, contextlib.suppress(OSError):
                socket.send_fds(peer, [b"page"], [self._listener.fileno()])

    def close(self) -> None:
        """Takes the socket back."""
        with contextlib.suppress(OSError):
            self._lending.shutdown(socket.SHUT_RDWR)
        self._lending.close()
        self._listener.close()
        shutil.rmtree(self._folder, ignore_errors=True)


def borrow(path: str) -> socket.socket:
    """Returns the listening socket of a SocketLender. Raises OSError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lender:
        lender.settimeout(5)
        try:
            lender.connect(path)
            _, descriptors, _, _ = socket.recv_fds(lender, 16, 1)
        except OSError as error:
            raise OSError(f"nobody lends a page's socket at {path}: {error.strerror or error}") from None
    if not descriptors:
        raise OSError(f"nobody lends a page's socket at {path}")
    return socket.socket(fileno=descriptors[0])
