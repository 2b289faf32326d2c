"""Lists what of a scene can change the light on its surfaces between keyframes: the rest is not compiled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.scene.model import Scene
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.materials.ggx import is_plain


@dataclass(frozen=True)
class LightChanges:
    """Holds which changes of light a scene knows, and which kinds of light.

    relative: surfaces and lights may move against each other. shadows: something that moves may throw a shadow. view:
    there are glossy surfaces, and they or the camera move. indirect: light comes over other surfaces, some of which
    move. facets: what has shading normals moves under lamps. lamps: lamps move, or what they shine on does and the
    camera may go with it. directional, point, spot, area: kinds of light; mapped: the sky is a map.
    """

    relative: bool = False
    shadows: bool = False
    view: bool = False
    indirect: bool = False
    facets: bool = False
    lamps: bool = False
    directional: bool = False
    point: bool = False
    spot: bool = False
    area: bool = False
    mapped: bool = False

    @property
    def covers(self) -> bool:
        """Tells whether shadows or beams may come over what stands still, and go."""
        return self.shadows or (self.spot and self.relative)

    @property
    def passes(self) -> bool:
        """Tells whether shadows, beams or lamps may come over what stands still, and go."""
        return self.covers or self.lamps

    @property
    def changes_lamps(self) -> bool:
        """Tells whether the lamps that shine on what a pixel sees may be others for a while."""
        return self.passes or self.facets

    @property
    def any(self) -> bool:
        """Tells whether any light can change."""
        return self.relative or self.shadows or self.view or self.indirect


def light_changes(scene: Scene, camera_body: int, paths: bool) -> LightChanges:
    """Finds what can change the light of a scene. camera_body: index of it; paths: whether light comes by paths."""
    instances = any(not is_static(scene, i.body) for i in scene.instances)
    lamps = any(not is_static(scene, light.body) for light in scene.lights)
    camera = not is_static(scene, camera_body)
    mapped = scene.environment_map is not None
    gloss = any(not is_plain(scene.materials[i.material]) for i in scene.instances)
    lit = bool(scene.lights) or mapped
    # Even of an even sky a glossy surface shows more or less by the angle.
    mirrored = lit or bool(np.any(scene.environment))
    shown_round = any(i.mesh.normals is not None and not is_static(scene, i.body) for i in scene.instances)
    kinds = {light.kind for light in scene.lights}
    return LightChanges(
        relative=lit and (instances or lamps),
        shadows=any(light.shadows for light in scene.lights) and (instances or lamps),
        view=mirrored and gloss and (instances or lamps or camera),
        indirect=paths and (instances or lamps),
        facets=bool(scene.lights) and shown_round,
        lamps=lamps or (bool(scene.lights) and instances and camera),
        directional="directional" in kinds,
        point="point" in kinds,
        spot="spot" in kinds,
        area="area" in kinds,
        mapped=mapped,
    )
