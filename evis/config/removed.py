"""Lists parameters that were removed, with what to use instead, for the error of a user who still gives one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from evis.config.suggestions import nearest

REMEDIES: Mapping[str, str] = {
    "adaptive_px": "it is gone, for time_tolerance:=0.0001 with a small upsampling has less error at the same run time",
    "sample_px": "it is gone, leave it out; time_tolerance:=0.0001 has less error at the same run time",
}
"""Removed parameter -> what to use instead."""


def instead(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Returns the remedy for a removed parameter, and the nearest known name for any other."""
    return REMEDIES.get(name) or nearest(name, known, otherwise)
