"""Tells which cameras' pixels take no samples between frames, whatever the tolerance of time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.scene.model import Camera
from nodes.renderer import parameters


def by_frames_alone(camera: Camera, params: Mapping[str, Any]) -> str:
    """Says why the pixels of a camera go by frames alone although there is a tolerance of time; "" where they do
    not."""
    if not parameters.by_paths(params):
        return ""
    why = "their light comes by paths (bounces, sky_occlusion)"
    return f"time_tolerance changes nothing: all {camera.width}x{camera.height} pixels go by frames alone, for {why}"
