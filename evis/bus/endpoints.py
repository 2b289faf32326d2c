"""Chooses the socket paths of a topic in the run's private directory, where only its user can connect."""

from __future__ import annotations

import hashlib
import os
import socket
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import zmq

from evis.bus.errors import BusError

SUN_PATH = 107
"""Longest path of a Unix socket [bytes]: sockaddr_un.sun_path less its terminating zero."""

LONGEST_ENDING = len(".credit")
HASHED = 24
"""Digits of a hash that stand for a long name: 96 bits, of which no two of a graph's thousand names are the same."""


@dataclass(frozen=True)
class Endpoints:
    """Holds the three addresses of one topic.

    lockstep: messages to declared consumers. credit: their greetings and credits. tap: the lossy copy.
    """

    lockstep: str
    credit: str
    tap: str

    def __iter__(self) -> Iterator[str]:
        return iter((self.lockstep, self.credit, self.tap))


def endpoints_for(directory: str | os.PathLike[str], topic: str) -> Endpoints:
    """Returns the Unix sockets of a topic in the run's directory. Raises BusError when the path is too long for one."""
    stem = _stem(directory, topic.strip("/"))
    return Endpoints(*(f"ipc://{stem}.{kind}" for kind in ("data", "credit", "tap")))


def outside_socket(directory: str | os.PathLike[str], node: str) -> Path:
    """Returns the Unix socket at which a node of a run takes messages from outside the graph. Raises BusError."""
    return Path(f"{_stem(directory, node)}.door")


def _stem(directory: str | os.PathLike[str], name: str) -> Path:
    """Makes the path of a topic's or node's sockets without ending, with a hash in place of a name that is too long."""
    folder = Path(directory).absolute()
    room = SUN_PATH - LONGEST_ENDING - len(os.fsencode(folder / "x")) + 1
    file = name.replace("/", "~")  # no name has a '~', so that they stay distinct
    if len(os.fsencode(file)) > room:
        file = "~" + hashlib.sha256(os.fsencode(name)).hexdigest()[:HASHED]
    if len(file) > room:
        raise BusError(
            f"the path of the run directory {folder} leaves too few of the {SUN_PATH} bytes that the system allows "
            "a socket: set XDG_RUNTIME_DIR to a shorter folder"
        )
    return folder / file


def check_bind(address: str) -> None:
    """Raises BusError for an address that others could reach: only socket files in a directory of the user's
    own pass."""
    scheme, _, path = address.partition("://")
    # libzmq takes `@name` for the abstract namespace, which has no permissions, and `*` for a file in /tmp.
    if scheme != "ipc" or not path.startswith("/"):
        raise BusError(f"{address}: a topic is bound to ipc:// and the absolute path of a file, which stays private")
    _check_private(Path(path))


def _check_private(path: Path) -> None:
    try:
        status = path.parent.stat()
    except OSError as error:
        raise BusError(f"the run directory {path.parent} cannot be used: {error.strerror}") from None
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o077:
        raise BusError(f"the run directory {path.parent} must be yours alone: make it with mode 0700 (chmod 700)")
    # libzmq would silently take a live publisher's socket file away from it.
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return
    raise BusError(f"{path} is in use: another process already publishes this topic in this run")


def bind(sock: zmq.Socket, address: str) -> None:
    """Binds a socket. Raises BusError."""
    try:
        sock.bind(address)
    except zmq.ZMQError as error:
        raise BusError(f"cannot bind {address}: {error.strerror}") from None


def unlink(endpoints: Endpoints) -> None:
    """Removes the socket files of endpoints that were bound here; libzmq leaves them behind."""
    for address in endpoints:
        Path(address.removeprefix("ipc://")).unlink(missing_ok=True)
