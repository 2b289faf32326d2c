"""Exchanges control messages between the supervisor (ROUTER) and its processes (DEALER), as msgpack maps both ways.

From a process: {"ready"}, {"heartbeat", "stats", "busy_s"}, {"done", "summary"}, {"failed", "node", "text"}, {"want"},
{"tell", "node"}, which is for the user's eyes alone.
From the supervisor: {"go": 1}, {"stop": 1}, with "cause" where a failure ended the graph, {"bye": 1} (the answer to
done and failed: only then may the sender close, or the kernel may lose what it wrote last, libzmq#4660).
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

import msgpack
import zmq

HEARTBEAT_S = 0.5
"""Interval of the heartbeats [s]."""
BYE_S = 2.0
"""Longest wait of a process that ends for the supervisor's answer [s]."""
GO_S, LOOK_S = 0.05, 0.1
"""Time between two looks of a process that waits for the graph's start, and for the supervisor's answer [s]."""
LINGER_MS, SERVER_LINGER_MS = 1000, 200
"""Longest time for which a report, and a command, is still under way when its socket is closed."""


def control_address(directory: str) -> str:
    """Returns the endpoint of the control socket of the run in `directory`."""
    return f"ipc://{directory}/control"


class ControlServer:
    """Receives reports of the processes and sends them commands; the supervisor's end."""

    def __init__(self, address: str) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.ROUTER_HANDOVER, 1)  # a respawned process comes back under its old name
        self._socket.setsockopt(zmq.LINGER, SERVER_LINGER_MS)
        self._socket.bind(address)

    def poll(self, timeout_s: float) -> list[tuple[str, dict[str, Any]]]:
        """Waits for messages, `timeout_s` at most, and returns all that have come, in order, as (process, message)."""
        messages: list[tuple[str, dict[str, Any]]] = []
        if not self._socket.poll(int(timeout_s * 1000)):
            return messages
        while True:
            try:
                process, frame = self._socket.recv_multipart(zmq.NOBLOCK)[:2]
                body = msgpack.unpackb(frame, raw=False, unicode_errors="surrogateescape")
            except zmq.Again:
                return messages
            except (ValueError, msgpack.UnpackException):
                continue
            if isinstance(body, dict):
                messages.append((process.decode(errors="replace"), body))

    def send(self, process: str, message: dict[str, Any]) -> None:
        """Sends a message to a process; skips one that has ended."""
        with contextlib.suppress(zmq.ZMQError):
            self._socket.send_multipart([process.encode(), msgpack.packb(message)], zmq.NOBLOCK)

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()
        self._context.term()


class ControlClient:
    """Sends reports to the supervisor and receives its commands; a process's end.

    A thread of its own sends the heartbeats, so that a long update is not taken for a death.
    """

    def __init__(self, address: str, process: str) -> None:
        self.process = process
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.IDENTITY, process.encode())
        self._socket.setsockopt(zmq.LINGER, LINGER_MS)
        self._socket.connect(address)
        self._lock = threading.Lock()  # a socket may change threads, but only behind a fence
        self._stats: dict[str, Any] = {}
        self._alive_at = time.monotonic()
        self._closing = threading.Event()
        self._final = False
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._thread.start()

    def _send(self, message: dict[str, Any]) -> None:
        with self._lock, contextlib.suppress(zmq.ZMQError):
            # A name of a file need not be UTF-8, and what failed must be told all the same.
            packed = msgpack.packb(message, default=float, unicode_errors="surrogateescape")
            self._socket.send(packed, zmq.NOBLOCK)

    def _beat(self) -> None:
        number = 0
        while not self._closing.wait(HEARTBEAT_S):
            number += 1
            busy = time.monotonic() - self._alive_at
            self._send({"heartbeat": number, "stats": self._stats, "busy_s": busy})

    def ready(self) -> None:
        """Reports that every node of this process is set up and connected."""
        self._send({"ready": self.process})

    def wait_go(self, meanwhile: Callable[[], None]) -> bool:
        """Waits until all processes are ready. False when the graph is stopped instead.

        meanwhile: called again and again.
        """
        while True:
            self._alive_at = time.monotonic()
            meanwhile()
            for message in self.poll(GO_S):
                if "go" in message:
                    return True
                if "stop" in message:
                    return False

    def poll(self, timeout_s: float = 0.0) -> list[dict[str, Any]]:
        """Returns the commands that have come: {"go": 1}, {"stop": 1}; waits for the first, `timeout_s` at most."""
        commands = []
        with self._lock:
            wait = int(timeout_s * 1000)
            while self._socket.poll(wait):
                commands.append(msgpack.unpackb(self._socket.recv(zmq.NOBLOCK), raw=False))
                wait = 0
        return commands

    def heartbeat(self, stats: dict[str, Any]) -> None:
        """Reports that the main loop runs; `stats` (plain numbers and maps of them) go with the next heartbeat."""
        self._alive_at, self._stats = time.monotonic(), stats

    def want(self, topic: str) -> None:
        """Asks the supervisor to start the dormant node of a topic for a viewer."""
        self._send({"want": topic})

    def tell(self, node: str, text: str) -> None:
        """Sends one line for the user that no log and no topic may hold."""
        self._send({"tell": text, "node": node})

    def done(self, summary: dict[str, Any]) -> None:
        """Reports that all nodes of this process have ended; `summary` goes into the run's own."""
        self._send({"done": self.process, "summary": summary})
        self._final = True

    def failed(self, node: str, text: str) -> None:
        """Reports that a node raised; `text` is the one line for the user."""
        self._send({"failed": self.process, "node": node, "text": text})
        self._final = True

    def close(self) -> None:
        """Closes the socket, once the supervisor has the last message (or is gone: BYE_S)."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join()
        end = time.monotonic() + BYE_S
        while self._final and time.monotonic() < end:
            if any("bye" in message for message in self.poll(LOOK_S)):
                break
        self._socket.close()
        self._context.term()


def ask_for(directory: str, topic: str) -> None:
    """Asks the supervisor, from outside the graph, to start the dormant node that publishes `topic`."""
    context = zmq.Context()
    socket = context.socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, LINGER_MS)
    socket.connect(control_address(directory))
    socket.send(msgpack.packb({"want": topic}))
    socket.close()
    context.term()
