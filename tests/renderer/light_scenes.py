"""Scenes for the light tests: a plane before the camera, and every kind of light and gloss in one kernel."""

from typing import Any

import numpy as np
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.scene.model import Light, Material, Mesh, Scene, Waveform
from nodes.renderer.renderer import Renderer

ALBEDO = np.array([0.5, 0.25, 0.8])
NOWHERE = at(0, 0, -50)
EYE = at(0, 0, 0)


def facing(size: float = 20.0, z: float = 2.0) -> Mesh:
    """A plane of the static world that faces the camera."""
    mesh = quad(size, size)
    vertices = mesh.vertices * np.array([1, -1, -1], np.float32) + np.array([0, 0, z], np.float32)
    return Mesh(vertices, mesh.faces, None)


def lamp(centre: Any, half_u: Any, half_v: Any, radiance: float = 3.0, **more: Any) -> Light:
    """A rectangle that shines to the side of half_u x half_v."""
    colour = radiance * np.array([1.0, 0.5, 0.25])
    u, v = np.array(half_u, float), np.array(half_v, float)
    return Light("lamp", "area", colour, np.array(centre, float), half_u=u, half_v=v, **more)


def world(
    meshes: list[tuple[Mesh, int, int]], lights: list[Light], material: Material | None = None, **more: Any
) -> Scene:
    """Material 0 is `material` or diffuse, 1 white; body0 moves. Dark lights and an unseen ball complete the kernel."""
    dark, down = np.zeros(3), np.array([0, 0, 1.0])
    unlit = [
        Light("no sun", "directional", dark, down),
        Light("no bulb", "point", dark, -3 * down),
        Light("no spot", "spot", dark, -3 * down, direction=down, cone=(0.1, 0.2)),
        Light("no lamp", "area", dark, -3 * down, half_u=np.array([1.0, 0, 0]), half_v=np.array([0, 1.0, 0])),
    ]
    materials = [material or Material("diffuse", ALBEDO), Material("white", np.ones(3))]
    materials.append(Material("unseen", np.ones(3), roughness=0.5))
    unseen = [(sphere(1e-3, 2), 0, 2)]
    return scene(meshes + unseen, bodies=1, materials=materials, lights=[*lights, *unlit], **more)


def flickering(light: Light, frequency: float = 100.0, depth: float = 1.0) -> Light:
    light.waveform = Waveform("sine", frequency, depth)
    return light


def render(scene_: Scene, body: Any = NOWHERE, eye: Any = EYE, **more: Any) -> np.ndarray:
    """Radiance [H, W, 3]."""
    renderer = Renderer(scene_, scene_.cameras[0], **more)
    image = renderer.render(poses(body, eye))["radiance"][0].copy()
    assert renderer.counts()[0] == 0
    return image


def small() -> Any:
    return camera(24, 18, 20.0)
