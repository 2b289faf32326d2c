"""Parameters that there once were: who still gives one is told what to do instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from evis.config.suggestions import nearest

REMEDIES: Mapping[str, str] = {
    "adaptive_px": "it is gone, for time_tolerance:=0.0001 with a small upsampling has less error at the same run time",
    "sample_px": "it is gone, leave it out; time_tolerance:=0.0001 has less error at the same run time",
}
"""By name: what to do instead."""


def instead(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Returns the remedy for a parameter that is gone, and for any other unknown name what `nearest` does."""
    return REMEDIES.get(name) or nearest(name, known, otherwise)
