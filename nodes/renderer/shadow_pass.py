"""The shadow rays of an image in a pass before it is shaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

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

    Only bits of lights with shadows that are no area lights; `clear`, then `launch` where all is placed.
    """

    def __init__(self, visibility: Visibility, lights: LightSet, occluders: Occluders, normals: wp.array) -> None:
        self._visibility, self._lights, self._occluders, self._normals = visibility, lights, occluders, normals
        self._shadowed = visibility.put(np.array(shadowed(visibility), np.int32), wp.int32)
        self.hidden = visibility.empty(visibility.shape, wp.uint32)
        delta = {kind: kind in lights.kinds for kind in ("directional", "point", "spot")}
        self._kernel = shadow_kernels.make_shadow_rays(**delta, trees=occluders.trees)

    def clear(self) -> None:
        """Forget the last image's."""
        self.hidden.zero_()

    def launch(self) -> None:
        """Trace the rays of what the visibility has drawn."""
        v = self._visibility
        seen = [v.packed, v.triangle_instance, self._normals, v.rotation, v.translation]
        inputs = [v.view, *seen, self._lights.kernel, self._shadowed, self._occluders.casters, self.hidden]
        wp.launch(self._kernel, (len(self._shadowed), *v.tiles), inputs, device=v.device, block_dim=BLOCK)


def shadowed(visibility: Visibility) -> list[int]:
    """Lights that rays of a pass of their own go to; none where there are more lights than bits."""
    lights = visibility.scene.lights
    if len(lights) > MOST_LIGHTS or not len(visibility.geometry.triangles):
        return []
    return [index for index, light in enumerate(lights) if light.shadows and light.kind != "area"]
