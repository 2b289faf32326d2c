"""Where the sockets of a topic are: files in the run's private directory, or TCP."""

from __future__ import annotations

import ipaddress
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


@dataclass(frozen=True)
class Endpoints:
    """The three addresses of one topic.

    lockstep: messages to declared consumers. credit: their greetings and credits. tap: the lossy copy. server_key: the
    publisher's CURVE public key (Z85); without one, TCP is bound to this machine's loopback only.
    """

    lockstep: str
    credit: str
    tap: str
    server_key: str = ""

    def __iter__(self) -> Iterator[str]:
        return iter((self.lockstep, self.credit, self.tap))


def endpoints_for(directory: str | os.PathLike[str], topic: str) -> Endpoints:
    """Unix sockets for a topic in the run's directory. Raises BusError when the path is too long for a socket."""
    stem = Path(directory).absolute() / topic.strip("/").replace("/", "~")  # topics have no '~': names stay distinct
    paths = [f"{stem}.{kind}" for kind in ("data", "credit", "tap")]
    longest = max(len(os.fsencode(p)) for p in paths)
    if longest > SUN_PATH:
        raise BusError(
            f"the socket path {paths[1]} has {longest} bytes and the system allows {SUN_PATH}: "
            "choose a shorter run directory"
        )
    return Endpoints(*(f"ipc://{p}" for p in paths))


def tcp_endpoints(host: str = "127.0.0.1", port: int = 0, server_key: str = "") -> Endpoints:
    """TCP addresses `port`, `port + 1`, `port + 2`; port 0 lets the system choose (see Publisher.endpoints)."""
    ports = [str(port + i) if port else "*" for i in range(3)]
    lockstep, credit, tap = (f"tcp://{host}:{p}" for p in ports)
    return Endpoints(lockstep, credit, tap, server_key)


def check_bind(address: str, keyed: bool) -> None:
    """Refuse an address that others could reach: TCP beyond loopback without keys, an open directory."""
    scheme, _, rest = address.partition("://")
    if scheme == "tcp":
        host = rest.rsplit(":", 1)[0].strip("[]")
        if not keyed and not _loopback(host):
            raise BusError(
                f"{address} could be reached from other machines: give CURVE keys, or bind 127.0.0.1 (host '{host}')"
            )
    elif scheme == "ipc":
        _check_private(Path(rest))
    else:
        raise BusError(f"{address}: a topic is bound to ipc:// or tcp://")


def _loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False  # '*', an interface, a host name


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


def bind(sock: zmq.Socket, address: str) -> str:
    """Bind and return the address with its wildcards resolved. Raises BusError."""
    try:
        sock.bind(address)
    except zmq.ZMQError as error:
        raise BusError(f"cannot bind {address}: {error.strerror}") from None
    return sock.getsockopt_string(zmq.LAST_ENDPOINT)


def unlink(endpoints: Endpoints) -> None:
    """Remove the socket files of endpoints that were bound here; libzmq leaves them behind."""
    for address in endpoints:
        if address.startswith("ipc://"):
            Path(address.removeprefix("ipc://")).unlink(missing_ok=True)
