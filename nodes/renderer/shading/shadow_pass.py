"""Casts the shadow rays of an image, or of a list of its pixels, in a pass before it is shaded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from nodes.renderer.shading import shadow_kernels
from nodes.renderer.shadows.grid import ShadowGrid
from nodes.renderer.shadows.grid_kernels import Grid

if TYPE_CHECKING:
    from nodes.renderer.lights.lights import LightSet
    from nodes.renderer.raster.visibility import Visibility
    from nodes.renderer.shadows.occlusion import Occluders

MOST_LIGHTS = 32
"""Lights that there are bits for."""

BLOCK = 64
"""Threads that start and end together: rays differ in length, and a block waits for its longest one."""


class ShadowPass:
    """Fills `shadow_mask`, uint32 [E, H, W] on the device: bit l of a pixel from which light l is hidden by something.

    Only bits of lights with shadows that are no area lights. Of an image, `clear`, then `launch` where all is placed;
    of a list `launch_list`, and who shades it sets what was listed to 0 again. Lights that have a grid (ShadowGrid) are
    traced by it, the others by the occluders' trees.
    """

    def __init__(self, visibility: Visibility, lights: LightSet, occluders: Occluders, normals: wp.array) -> None:
        self._visibility, self._lights, self._occluders, self._normals = visibility, lights, occluders, normals
        every = shadowed(visibility)
        with_grid = [light for light in every if ShadowGrid.suits(visibility, occluders, light)]
        others = [light for light in every if light not in with_grid]
        self._grid = ShadowGrid(visibility, occluders, with_grid) if with_grid else None
        self._placed = False
        self.shadow_mask = wp.zeros(visibility.shape, dtype=wp.uint32, device=visibility.device)
        delta = {kind: kind in lights.kinds for kind in ("directional", "point", "spot")}
        # What rays go from and to, the grid that the lights have, and the kernels of an image and of a list.
        self._parts: list[tuple[Any, Any, wp.Kernel, wp.Kernel]] = []
        for part, grid in ((with_grid, self._grid), (others, None)):
            if part:
                how = {"trees": occluders.trees, "grids": grid is not None, "fast_math": visibility.device.is_cuda}
                kernels = shadow_kernels.make_shadow_rays(**delta, **how)
                self._parts.append((self._receivers(part), Grid() if grid is None else grid.kernel, *kernels))

    def kernels(self, listed: bool) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that trace the rays of an image, or of a list of pixels, as `build_together` takes them."""
        rays = [(of_list if listed else of_image, BLOCK) for _, _, of_image, of_list in self._parts]
        return [*rays, *(self._grid.kernels if self._grid else [])]

    def clear(self) -> None:
        """Forgets the last image's bits."""
        self.shadow_mask.zero_()

    def place(self) -> None:
        """Places the grid for the visibility's placed instances; who never calls it has that done by each launch."""
        self._placed = True
        if self._grid is not None:
            self._grid.place()

    def launch(self) -> None:
        """Traces the rays of what the visibility has drawn."""
        self._place_once()
        v = self._visibility
        for on, grid, kernel, _ in self._parts:
            inputs = [v.view, on, self._lights.kernel, self._occluders.casters, grid]
            wp.launch(
                kernel, (on.shadowed.size, *v.tiles), inputs, [self.shadow_mask], device=v.device, block_dim=BLOCK
            )

    def launch_list(self, workers: int, pixels: wp.array, count: wp.array) -> None:
        """Traces the shadow rays of count[0] pixels of a list, int32 indices into [E, H, W]."""
        self._place_once()
        v = self._visibility
        for on, grid, _, kernel in self._parts:
            inputs = [v.view, on, self._lights.kernel, self._occluders.casters, grid, workers, pixels, count]
            wp.launch(kernel, (on.shadowed.size, workers), inputs, [self.shadow_mask], device=v.device, block_dim=BLOCK)

    def _place_once(self) -> None:
        if not self._placed and self._grid is not None:
            self._grid.place()

    def _receivers(self, lights: list[int]) -> Any:
        """Gathers what the rays to some lights start from."""
        v, on = self._visibility, shadow_kernels.Receivers()
        on.packed, on.instance, on.normals, on.rotation = v.packed, v.triangle_instance, self._normals, v.rotation
        on.shadowed = v.put(np.array(lights, np.int32), wp.int32)
        return on


def shadowed(visibility: Visibility) -> list[int]:
    """Gives lights that rays of a pass of their own go to; none where there are more lights than bits."""
    lights = visibility.scene.lights
    if len(lights) > MOST_LIGHTS or not len(visibility.geometry.triangles):
        return []
    return [index for index, light in enumerate(lights) if light.shadows and light.kind != "area"]
