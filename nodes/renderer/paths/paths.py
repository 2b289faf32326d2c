"""Prepares the sources of light of a scene's paths, and launches their kernel after a `Shading`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from evis.geometry.triangles import areas
from evis.media.colour import REC709
from evis.scene.model import Light, Scene
from nodes.renderer.lights.features import Features
from nodes.renderer.paths import path_kernels
from nodes.renderer.paths.path_tracer_kernels import PathLimits
from nodes.renderer.paths.sampling_kernels import EMITTER, LIGHT_PROXY, PathSources
from nodes.renderer.paths.vertex_kernels import PathMeshes
from nodes.renderer.raster.visibility import Visibility

LUMINANCE = np.array(REC709)

NEAR = 2.0
"""A glowing instance is the proxy of a light that lies within this many times its radius from its middle."""

MOST_BOUNCES = 63

make_paths = cache(path_kernels.make_paths)


@dataclass(frozen=True)
class PathOptions:
    """Holds how far light is followed, and by how many paths.

    bounces: surfaces, after the one that is seen, over which light may come. samples: paths for each pixel. roulette:
    from the second bounce on a path goes on with the chance of its weight, and counts for more then.
    """

    bounces: int = 0
    samples: int = 16
    roulette: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.bounces <= MOST_BOUNCES:
            raise ValueError(f"bounces is {self.bounces}; it must be 0 ... {MOST_BOUNCES}")
        if self.samples < 1:
            raise ValueError(f"path_samples is {self.samples}; it must be at least 1")


class Paths:
    """Adds to the direct light of lights what comes from the sky, glowing surfaces, and over other surfaces.

    features: of the shading kernel. half: whether light is written as float16.
    """

    def __init__(self, visibility: Visibility, options: PathOptions, features: Features, half: bool) -> None:
        scene, geometry, put = visibility.scene, visibility.geometry, visibility.put
        self.visibility = visibility
        self._limits = PathLimits()
        self._limits.bounces, self._limits.samples = options.bounces, options.samples
        self._limits.roulette = int(options.roulette)
        self.direct = visibility.empty(visibility.shape, wp.vec3)
        self._bodies = PathMeshes()
        self._bodies.first = put(geometry.first[:-1], wp.int32)
        self._bodies.two_sided, self._bodies.points = visibility.two_sided, visibility.points
        kinds = emitter_kinds(scene, visibility)
        emits = kinds == int(EMITTER)
        self._sources = make_path_sources(visibility, emits)
        self._sources.emitter_kind = put(kinds, wp.int32)
        only_lights = not emits.any() and scene.environment_map is None and not np.any(scene.environment)
        self._kernels = make_paths(features, bool(emits.any()), only_lights, half)

    def kernel(self, listed: bool) -> wp.Kernel:
        """Makes the kernel for all pixels of the rows it gets, or for those of a list; arguments as of
        `make_shade`'s."""
        return self._kernels[listed]

    def arguments(self, light: list[Any], image: Any) -> list[Any]:
        """Makes the kernels' arguments from `limits` on. light: what is seen, surfaces, lights, sky and casters."""
        return [self._limits, *light, self._bodies, self._sources, self.direct, image]


def emitter_kinds(scene: Scene, visibility: Visibility) -> np.ndarray:
    """Gives int32 [I]: EMITTER for an instance that emits light, LIGHT_PROXY for one that shows a light, 0 for others.

    The light of a lamp would be counted twice if its shade lit others too, and what the shade throws back of the light
    within it is part of that light: paths end at a proxy.
    """
    geometry = visibility.geometry
    found = np.zeros(len(scene.instances), np.int32)
    for index, instance in enumerate(scene.instances):
        if np.any(scene.materials[instance.material].emission) and len(instance.mesh.faces):
            reach, centre = NEAR * float(geometry.radius[index]), geometry.translation[index]
            shown = any(_shows(light, instance.body, centre, reach) for light in scene.lights)
            found[index] = int(LIGHT_PROXY if shown else EMITTER)
    return found


def _shows(light: Light, body: int, centre: np.ndarray, reach: float) -> bool:
    """Tells whether a glowing surface on a body is the visible part of a light."""
    if light.kind == "directional" or light.body != body:
        return False
    return bool(np.linalg.norm(np.asarray(light.vector, np.float64) - centre) <= reach)


def make_path_sources(visibility: Visibility, emits: np.ndarray) -> Any:
    """Makes the kernels' sources of light that are no lights; emits: bool [I], those that are EMITTER."""
    scene, geometry, put = visibility.scene, visibility.geometry, visibility.put
    instance = geometry.triangle_instance
    chosen = np.flatnonzero(emits[instance]) if len(instance) else np.zeros(0, np.int64)
    corners = geometry.vertices[geometry.triangles[chosen]].astype(np.float64).reshape(-1, 3, 3)
    area = areas(corners)
    emission = np.array([m.emission for m in scene.materials], np.float64).reshape(-1, 3) @ LUMINANCE
    material = np.array([i.material for i in scene.instances], np.int64)
    power = area * emission[material[instance[chosen]]]
    sources = PathSources()
    sources.emitter_cdf = put(_cdf(power), wp.float32)
    sources.emitter_instance = put(instance[chosen], wp.int32)
    sources.emitter_corners = put(corners, wp.vec3)
    sources.emitter_density = 1.0 / float(power.sum()) if power.sum() > 0 else 0.0
    rows, columns, pdf = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    if scene.environment_map is not None:
        rows, columns, pdf = sky_distribution(np.asarray(scene.environment_map, np.float64))
    sources.sky_row_cdf = put(rows, wp.float32)
    sources.sky_column_cdf, sources.sky_pdf = put(columns, wp.float32), put(pdf, wp.float32)
    return sources


def sky_distribution(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gives the CDF of the rows [h], that of the columns in each row [h, w], and each texel's share times their number.

    A texel's luminance counts with its neighbours', for between their centres the map is interpolated, and with a part
    of the mean, so that no direction is left out.
    """
    h, w = radiance.shape[:2]
    light = radiance @ LUMINANCE
    light = light / 2 + (np.roll(light, 1, 1) + np.roll(light, -1, 1)) / 4
    padded = np.pad(light, ((1, 1), (0, 0)), "edge")
    light = padded[1:-1] / 2 + (padded[:-2] + padded[2:]) / 4
    solid = -np.diff(np.cos(np.linspace(0, np.pi, h + 1)))[:, None] * np.ones((1, w))
    mean = (light * solid).sum() / solid.sum()
    weight = (light + 0.05 * mean + 1e-30) * solid
    share = weight / weight.sum()
    columns = np.cumsum(weight, 1)
    return _cdf(weight.sum(1)), columns / columns[:, -1:], share * (h * w)


def _cdf(weight: np.ndarray) -> np.ndarray:
    """Gives the cumulative distribution of weights, the last one 1; zeros where there is no weight."""
    total = np.cumsum(weight)
    return total / total[-1] if len(total) and total[-1] > 0 else total
