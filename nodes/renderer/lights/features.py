"""Lists what of a scene the kernels of light have code for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Features:
    """Holds what a scene needs of the kernels of light: the rest is not compiled. Equal ones share their kernels."""

    textures: bool = False
    """Some instance shows one."""
    smooth: bool = False
    """Some instance has shading normals of its own."""
    vertex_colours: bool = False
    """Some mesh has colours at its vertices."""
    gloss: bool = False
    """Some material is not plain diffuse."""
    directional: bool = False
    """There are lights of this kind; likewise point, spot and area."""
    point: bool = False
    spot: bool = False
    area: bool = False
    hard: bool = False
    """A light that is no area light has shadows."""
    soft: bool = False
    """An area light has shadows."""
    flicker: bool = False
    """Strengths of lights change."""
    sky_map: bool = False
    """The sky is a map."""
    ambient: bool = True
    """Surfaces get the sky's light, which nothing hides; without it paths bring it."""
    trees: bool = False
    """Casters lie in trees."""
    merged: bool = False
    """There may be one mesh of all still triangles."""
    cached: bool = False
    """Light on still surfaces is remembered."""
    shadow_pass: bool = False
    """Rays to lights that are points have been traced before, by shading/shadow_kernels."""
    grids: bool = False
    """Rays to some lights that are points go by grids over what these see (shadows/grid_kernels)."""
    tiled: bool = False
    """Threads that run together have a tile of pixels (view_kernels.tile_pixel)."""
    by_runs: bool = False
    """Several samples of a lobe are taken at a time, in a CPU's way (lobe_kernels)."""
    half: bool = False
    """Light is written as float16."""
    fast_math: bool = False
    """On a GPU: quotients, roots and powers may be off by units in the last place, for a fifth fewer instructions."""

    @property
    def delta(self) -> bool:
        """Tells whether there are lights that are no area lights."""
        return self.directional or self.point or self.spot

    @property
    def lit(self) -> bool:
        """Tells whether there are lights."""
        return self.delta or self.area

    @property
    def shadows(self) -> bool:
        """Tells whether any light has shadows."""
        return self.hard or self.soft
