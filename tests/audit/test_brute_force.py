"""Brute force has the renderer's pixels: rays find what the raster finds, and the light there is the same."""

from dataclasses import replace

import numpy as np
import pytest
from audit_rig import LIGHT_SCENES, poses_at, small

from evis.scene.model import Camera, Scene
from nodes.audit.brute_force.brute_force import BruteForce
from nodes.interpolator.rigid.placement import Placement
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer

STAMPS = np.array([0, 33_333_333, 70_000_000, 123_456_789])
SHIPPED = ("drone", "fidget_spinner", "spinning_disk", "stereo_room", "tunnel_exit", "warehouse")


def compare(scene: Scene, camera: Camera, samples: int = 1, paths: PathOptions | None = None) -> tuple[float, float]:
    """Shares of 300 pixels at four instants with the same bits, and with 1e-5 of the light at least."""
    count = 300
    rng = np.random.default_rng(3)
    pixels = np.stack([rng.integers(0, camera.width, count), rng.integers(0, camera.height, count)], -1)
    movers, poses = Placement(scene).movers, poses_at(scene, STAMPS)
    force = BruteForce(scene, camera, count, slots=3, samples=samples, paths=paths)
    force.choose(pixels[None])
    force.rest(poses[0], movers)
    renderer = SupersampledRenderer(scene, camera, samples, paths=paths) if samples > 1 else Renderer(
        scene, camera, paths=paths
    )  # fmt: skip
    which = np.arange(count)
    same = close = 0
    for k, t in enumerate(STAMPS):
        found, _ = force.luminance_at(poses[k : k + 1, movers], STAMPS[k : k + 1], which * 0, which * 0, which)
        image = renderer.render(poses[k : k + 1], None, ("luminance",), t_ns=int(t))["luminance"][0]
        wanted = image[pixels[:, 1], pixels[:, 0]]
        same += int((found == wanted).sum())
        close += int(np.isclose(found, wanted, rtol=1e-5, atol=0).sum())
    return same / (4 * count), close / (4 * count)


@pytest.mark.parametrize("path", sorted(LIGHT_SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_light_scene_has_the_bits_of_the_renderer(path) -> None:
    scene = small(path.stem, 64, 48)
    assert compare(scene, scene.cameras[0]) == (1.0, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_every_scene_has_the_light_of_the_renderer(name) -> None:
    """But for points on edges and where surfaces lie in one another, which a ray and the raster may tell apart."""
    scene = small(name, 96, 72)
    same, close = compare(scene, scene.cameras[0])
    assert same > 0.97 and close > 0.98


@pytest.mark.parametrize(
    ("model", "coefficients"), [("plumb_bob", (-0.2, 0.05, 0.001, -0.001, 0.0)), ("equidistant", (0.05, 0.0, 0.0, 0.0))]
)
def test_through_a_lens(model, coefficients) -> None:
    """Textures too, whose detail depends on the rays of the neighbours."""
    scene = small("camera_lamp", 64, 48)
    camera = replace(scene.cameras[0], distortion_model=model, distortion=coefficients)
    same, close = compare(scene, camera)
    assert same > 0.99 and close > 0.995


def test_samples_of_a_pixel_are_averaged() -> None:
    """In another order than the renderer's, so to rounding."""
    scene = small("moving_lamp", 40, 30)
    _, close = compare(scene, scene.cameras[0], samples=3)
    assert close > 0.995


def test_light_by_paths_is_the_same() -> None:
    scene = small("area_light", 40, 30)
    assert compare(scene, scene.cameras[0], paths=PathOptions(1, 4)) == (1.0, 1.0)


def test_the_back_of_a_one_sided_surface_is_looked_through() -> None:
    scene = small("matte_box", 40, 30)
    for material in scene.materials:
        material.two_sided = False
    wall = next(i for i in scene.instances if i.name == "wall")
    wall.pose[:3] = [0.0, -1.0, 0.0]
    wall.pose[3:] = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    seen = compare(scene, scene.cameras[0])
    assert seen == (1.0, 1.0)
