"""Binds a server's socket, to this machine only by default, and decides by which names and token it is reached."""

from __future__ import annotations

import errno
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterable

DEFAULT_PORT = 8421
"""Port of the page."""
TRIED_PORTS = 32
"""Ports tried upwards from the default before any free one is taken."""
LOCAL = ("localhost", "127.0.0.1", "::1")
"""Names under which a server may always be asked for: they lead to this machine, or to the near end of an ssh -L."""
OF_A_NODE = "port:=0 is any free one, in a launch file params: {port: 0}"
"""How the port of a node is chosen, for who finds it taken."""
_HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([^\s:@/\[\]]+))(?::\d{1,5})?\Z")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{8,128}\Z")


def is_loopback(host: str) -> bool:
    """Says whether a host is 127.0.0.0/8, ::1 or localhost."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_token(host: str, token: str | None) -> None:
    """Raises ValueError with the remedy where a host is not to be served without a token, or not with this one."""
    if token is None and not is_loopback(host):
        raise ValueError(
            f"host {host} is reachable from other machines: give a token of your own (token:=env:NAME, in a launch "
            "file params: {token: env:NAME}), or keep 127.0.0.1 and use ssh -L"
        )
    if token is not None and not _TOKEN.match(token):
        raise ValueError("token must be 8 to 128 letters, digits, '-' or '_'")


def choose_token(host: str, token: str | None) -> str:
    """Returns the token given, or a random one of 128 bits for a loopback host. Raises as `check_token` does."""
    check_token(host, token)
    return secrets.token_urlsafe(16) if token is None else token


def plain_name(name: str) -> str:
    """Writes a name or address as it is compared: small letters, addresses as ipaddress has them."""
    try:
        address = ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return name.lower()
    mapped = getattr(address, "ipv4_mapped", None)
    return str(mapped or address)


def names_of(listener: socket.socket, given: Iterable[str]) -> frozenset[str]:
    """Returns the names of the server: this machine's own, the address listened on, and the `given` ones.

    Any other name is a foreign site's that leads here (DNS rebinding).
    """
    return frozenset(map(plain_name, [*LOCAL, listener.getsockname()[0], *given]))


def is_served(hosts: list[str], names: frozenset[str], reached: str) -> bool:
    """Says whether a request's Host headers name the server: one, of `names` or the address that was `reached`."""
    match = _HOST.match(hosts[0]) if len(hosts) == 1 else None
    return match is not None and plain_name(match[1] or match[2]) in names | {plain_name(reached)}


def bind(host: str, port: int | None, remedy: str = OF_A_NODE) -> tuple[socket.socket, str]:
    """Binds a listening socket, with a note where the port is not the one that was to be expected.

    port: a number (0 = any free one), or None for DEFAULT_PORT or the next free one. remedy: how another is chosen.
    Raises OSError or ValueError with one clear line.
    """
    candidates = [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + TRIED_PORTS), 0]
    try:
        family, _, _, _, address = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError:
        raise ValueError(f"host '{host}' is not an address of this machine; use 127.0.0.1") from None
    for candidate in candidates:
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((address[0], candidate, *address[2:]))
            listener.listen(64)
        except OSError as error:
            listener.close()
            if port is None and candidate and error.errno == errno.EADDRINUSE:
                continue
            if error.errno == errno.EADDRINUSE:
                raise OSError(f"port {candidate} is taken; choose another ({remedy})") from None
            raise OSError(f"cannot listen on {host}:{candidate}: {error.strerror}") from None
        note = f"port {DEFAULT_PORT} is taken" if port is None and candidate != DEFAULT_PORT else ""
        return listener, note
    raise OSError(f"no free port on {host}")


def place(listener: socket.socket) -> str:
    """Returns host and port as they stand in an address, such as 127.0.0.1:8421 or [::1]:8421."""
    host, port = listener.getsockname()[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def url(listener: socket.socket, token: str) -> str:
    """Returns the address of the page, to open in a browser."""
    return f"http://{place(listener)}/?token={token}"
