"""Tells which of a camera's parameters have no effect, given what is to be played."""

from __future__ import annotations

from collections.abc import Mapping

from nodes.camera.find import is_model


def without_effect(file: str | None, emulate: str | None) -> Mapping[str, str]:
    """Returns the parameters that have no effect: those of a device where the recording `file` is played (or `emulate`
    names one), and those of a recording where a device is read.

    Parameter -> why it changes nothing.
    """
    if is_model(emulate):
        return {}
    no_device = "it is for an emulated camera"
    if not (file or emulate):
        return {
            "faults": no_device,
            "pace": "a camera gives events as they happen",
            "topic": "it is for a recording",
        }
    found = dict.fromkeys(("settings", "reconnect"), "a recording is played in place of a camera")
    return found | {"faults": no_device} | ({"pace": "emulate plays at real pace"} if emulate else {})
