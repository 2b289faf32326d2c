"""The shadow rays of an image, or of a list of its pixels, in a pass before it is shaded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from nodes.renderer import shadow_kernels

if TYPE_CHECKING:
    from nodes.renderer.lights import LightSet
    from nodes.renderer.occlusion import Occluders
    from nodes.renderer.visibility import Visibility

MOST_LIGHTS = 32
"""Lights that there are bits for."""

BLOCK = 64
"""Threads that start and end together: rays differ in length, and a block waits for its longest one."""


class ShadowPass:
    """Fills `hidden`, uint32 [E, H, W] on the device: bit l of a pixel from which light l is hidden by something.

    Only bits of lights with shadows that are no area lights. Of an image, `clear`, then `launch` where all is placed;
    of a list `launch_list`, and who shades it sets what was listed to 0 again.
    """

    def __init__(self, visibility: Visibility, lights: LightSet, occluders: Occluders, normals: wp.array) -> None:
        self._visibility, self._lights, self._occluders, self._normals = visibility, lights, occluders, normals
        self._shadowed = visibility.put(np.array(shadowed(visibility), np.int32), wp.int32)
        self.hidden = wp.zeros(visibility.shape, dtype=wp.uint32, device=visibility.device)
        delta = {kind: kind in lights.kinds for kind in ("directional", "point", "spot")}
        self._kernel, self._list_kernel = shadow_kernels.make_shadow_rays(**delta, trees=occluders.trees)

    def clear(self) -> None:
        """Forget the last image's."""
        self.hidden.zero_()

    def launch(self) -> None:
        """Trace the rays of what the visibility has drawn."""
        v = self._visibility
        dim = (len(self._shadowed), *v.tiles)
        wp.launch(self._kernel, dim, self._seen(), [self.hidden], device=v.device, block_dim=BLOCK)

    def launch_list(self, workers: int, pixels: wp.array, count: wp.array) -> None:
        """Trace those of count[0] pixels of a list, int32 indices into [E, H, W]."""
        inputs = [*self._seen(), workers, pixels, count]
        dim, device = (len(self._shadowed), workers), self._visibility.device
        wp.launch(self._list_kernel, dim, inputs, [self.hidden], device=device, block_dim=BLOCK)

    def _seen(self) -> list[Any]:
        """What the kernels have in common."""
        v = self._visibility
        seen = [v.view, v.packed, v.triangle_instance, self._normals, v.rotation, v.translation]
        return [*seen, self._lights.kernel, self._shadowed, self._occluders.casters]


def shadowed(visibility: Visibility) -> list[int]:
    """Lights that rays of a pass of their own go to; none where there are more lights than bits."""
    lights = visibility.scene.lights
    if len(lights) > MOST_LIGHTS or not len(visibility.geometry.triangles):
        return []
    return [index for index, light in enumerate(lights) if light.shadows and light.kind != "area"]
