"""Decides by its origin which web page may read the graph: any page that the user visits could try to."""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import urlsplit

from evis.web.address import LOCAL, plain_name

SITE = "foxglove.dev"
DESKTOP = "file://"
"""What desktop programs made with Electron say, whose pages are files; so does a page that the user opens from disk."""


def normal(origin: str) -> str:
    """Writes an origin as it is compared: small letters, and no slash at its end."""
    return origin.strip().lower().rstrip("/")


def may_read(origins: list[str], listed: Iterable[str]) -> bool:
    """Says whether the Origin headers of a request are none, as of a program that is no browser, or one that may read.

    It may if it is a page of this machine's, from its disk or at any port, of foxglove.dev by https, or `listed`.
    """
    if not origins:
        return True
    if len(origins) > 1:
        return False
    if origins[0] == DESKTOP or normal(origins[0]) in set(map(normal, listed)):
        return True
    try:
        parts = urlsplit(origins[0])
        host, port = parts.hostname or "", parts.port
    except ValueError:
        return False
    if origins[0].partition("://")[2] != parts.netloc or "@" in parts.netloc:
        return False
    if parts.scheme in ("http", "https") and plain_name(host) in LOCAL:
        return True
    return parts.scheme == "https" and port in (None, 443) and host.endswith(f".{SITE}")
