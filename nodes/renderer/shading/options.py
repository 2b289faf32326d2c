"""Holds the options of shading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions


@dataclass(frozen=True)
class ShadingOptions:
    """Holds the options of shading."""

    light_samples: int = 16
    """Rays for each area light and pixel, a square number."""
    paths: PathOptions | None = None
    """Light over other surfaces, and that of the sky which things hide; None leaves it out."""
    half: bool = False
    """Radiance and luminance are float16."""
    remember: bool = True
    """False for `shade_list`, which never sees all of an image."""
    split: bool | None = None
    """Whether shadow rays to lights that are points are traced in a pass of their own before anything is shaded, None:
    on a GPU; the image is the same."""
    merged: bool | None = None
    """Whether what stands still in the world is one structure for rays, None: for paths on a GPU."""
    traced: bool = False
    """Whether there are structures for rays also where no light has shadows: for who asks them what is seen."""
