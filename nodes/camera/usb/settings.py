"""Declares the settings that every USB camera has, and tells in what two configurations differ."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from nodes.camera.interface.settings import Configuration, setting

UNKNOWN = object()
"""Value of a setting of which it is not known whether it was written."""


@dataclass
class UsbSettings(Configuration):
    """Holds the settings that every USB camera has. Families add their own."""

    packet_ms: float = setting(10.0, "length of a packet's interval, device time", "ms", 0.01, 10_000, live=False)
    longest_ms: float = setting(100.0, "longest packet while the host is behind", "ms", 0.01, 10_000, live=False)
    raw: bool = setting(False, "packets carry the wire bytes too", live=False)
    buffers: int = setting(256, "buffers between USB and decoder", "", 4, 4096, live=False)
    buffer_kib: int = setting(128, "size of one buffer", "KiB", 16, 8192, live=False)
    reconnect: bool = setting(False, "wait for a camera that was unplugged to come back", live=False)
    transfers: str = setting(
        "queued", "queued: several reads wait at the endpoint at once; single: one at a time", live=False
    )
    decoder: str = setting("warp", "warp (fast; compiled once) or numpy", live=False)

    def of_the_camera(self) -> dict[str, Any]:
        """Returns the settings that the camera itself holds, by name, without those of the host and those UNKNOWN."""
        host = {f.name for f in dataclasses.fields(UsbSettings)}
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in host}
        return {name: value for name, value in own.items() if value is not UNKNOWN}


def differing(settings: Any, before: Any) -> list[str]:
    """Returns the names of the settings that are not those of `before`, of which some may be UNKNOWN."""
    names = [f.name for f in dataclasses.fields(settings)]
    return [name for name in names if getattr(settings, name) != getattr(before, name)]
