"""Holds the lights of a scene: checked, in the camera's frame, and as strong as they are at an instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.runtime.clock import NS
from evis.scene.model import WORLD, Light, Scene, Waveform
from nodes.renderer.lights import light_kernels, place_kernels
from nodes.renderer.raster.scene_arrays import store
from nodes.renderer.raster.visibility import Visibility

KINDS = {
    "directional": int(light_kernels.DIRECTIONAL),
    "point": int(light_kernels.POINT),
    "spot": int(light_kernels.SPOT),
    "area": int(light_kernels.AREA),
}

PLACED = ("vector", "axis", "half_u", "half_v")
"""What of the lights depends on where their bodies and the camera are."""


class LightSet:
    """Holds the lights of a scene on the device, for the kernels as `kernel`.

    samples: shadow rays of an area light for a surface point whose view of it may be blocked, a square number; as many
    for the gloss of a surface that is not plain diffuse, twice. Raises ValueError naming a light that is not usable.
    """

    def __init__(self, visibility: Visibility, samples: int) -> None:
        scene, put = visibility.scene, visibility.put
        self.lights = scene.lights
        for light in scene.lights:
            _check(scene, light)
        self.side = round(samples**0.5)
        if samples < 1 or self.side**2 != samples:
            raise ValueError(f"light_samples is {samples}; it must be a square number: 1, 4, 9, 16, ...")
        self.kinds = {light.kind for light in scene.lights}
        self.flickers = any(light.waveform is not None for light in scene.lights)
        self._colour = np.array([l.colour for l in scene.lights], np.float64).reshape(-1, 3)
        at_start = np.array([waveform_strength(l.waveform, 0) for l in scene.lights])
        self._strength = np.tile(at_start, (visibility.envs, 1))
        self._visibility = visibility
        self._fixed = [
            put(np.array([l.body for l in scene.lights], np.int32), wp.int32),
            put(np.array([l.kind != "directional" for l in scene.lights], np.int32), wp.int32),
            put(fixed_vectors(scene.lights), wp.vec3d),
        ]
        shape = (visibility.envs, len(scene.lights))
        self.kernel: Any = light_kernels.Lights()
        self.kernel.kind = put(np.array([KINDS[l.kind] for l in scene.lights], np.int32), wp.int32)
        self.kernel.colour = put(self._colour * self._strength[..., None], wp.vec3)
        self.kernel.shadow = put(np.array([l.shadows for l in scene.lights], np.int32), wp.int32)
        self.kernel.cone = put(np.array([_cone(l) for l in scene.lights]).reshape(-1, 2), wp.vec2)
        for name in PLACED:
            setattr(self.kernel, name, visibility.empty(shape, wp.vec3))
        self.kernel.side = self.side
        self._now = self.kernel.colour
        self._chosen: dict[Waveform | None, wp.array] = {}

    @property
    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that `launch` and `place` launch, as `build_together` takes it."""
        return [(place_kernels.place_lights, LAUNCH_BLOCK)] if self.lights else []

    def set_times(self, t_ns: np.ndarray) -> bool:
        """Sets flickering lights to what they are at int64 [E] ns, one instant for each environment; True where one
        differs."""
        if not self.flickers:
            return False
        strength = waveform_strengths([l.waveform for l in self.lights], np.asarray(t_ns, np.int64))
        strength = np.broadcast_to(strength, self._strength.shape)
        if np.array_equal(strength, self._strength):
            return False
        self._strength = strength
        store(self._now, self._colour * strength[..., None])
        return True

    def select(self, waveform: Waveform | None) -> None:
        """Chooses the lights of launches from now on: those that do not flicker and, at their mean, those of a
        waveform."""
        if waveform not in self._chosen:
            shine = np.array([l.waveform is None or l.waveform == waveform for l in self.lights], np.float64)
            colour = np.ones((self._visibility.envs, 1, 1)) * self._colour * shine[:, None]
            self._chosen[waveform] = self._visibility.put(colour, wp.vec3)
        self.kernel.colour = self._chosen[waveform]

    def select_now(self) -> None:
        """Has all lights in launches from now on, as `set_times` says."""
        self.kernel.colour = self._now

    def launch(self) -> None:
        """Writes where the lights are, for the poses that the visibility has on the device: a launch only."""
        self.place(self._visibility.poses, self.kernel)

    def elsewhere(self, rows: int) -> Any:
        """Makes the kernels' struct of the same lights with places of their own, [rows, L], for `place`."""
        other: Any = light_kernels.Lights()
        for name in ("kind", "colour", "shadow", "cone", "side"):
            setattr(other, name, getattr(self.kernel, name))
        for name in PLACED:
            setattr(other, name, self._visibility.empty((rows, len(self.lights)), wp.vec3))
        return other

    def place(self, poses: wp.array, kernel: Any, rows: slice | None = None) -> None:
        """Writes where the lights are into rows of a struct, or all of it, for poses transformd [rows, N]: a launch
        only."""
        if not self.lights:
            return
        v = self._visibility
        inputs = [poses, v.camera_body, *self._fixed]
        outputs = [getattr(kernel, name) for name in PLACED]
        if rows is not None:
            outputs = [array[rows] for array in outputs]
        dim = (poses.shape[0], len(self.lights))
        wp.launch(place_kernels.place_lights, dim=dim, inputs=inputs, outputs=outputs, device=v.device)


def waveform_strength(waveform: Waveform | None, t_ns: int) -> float:
    """Gives the factor of a light's strength at an instant [ns]; 1 without a waveform.

    It is the strength at that instant, not a mean over an exposure.
    """
    if waveform is None:
        return 1.0
    phase = waveform_phase(waveform, t_ns)
    if waveform.kind == "sine":
        return max(0.0, 1.0 + waveform.depth * float(np.sin(2 * np.pi * phase)))
    if phase < waveform.duty:
        return 1.0 + waveform.depth * (1.0 - waveform.duty) / waveform.duty
    return 1.0 - waveform.depth


def waveform_phase(waveform: Waveform, t_ns: int) -> float:
    """Gives which part of its period a waveform is in at an instant [ns], 0 to 1.

    It is counted exactly, so that it is as good after days as at the start.
    """
    per_ns, at_zero, whole = _whole_numbers(waveform)
    return (per_ns * t_ns + at_zero) % whole / whole


@lru_cache(maxsize=4096)
def _whole_numbers(waveform: Waveform) -> tuple[int, int, int]:
    """Gives whole numbers in which a waveform is counted: what passes of it in a ns, and up to 0, and its period."""
    per_ns, at_zero = Fraction(waveform.frequency) / NS, Fraction(waveform.phase)
    whole = math.lcm(per_ns.denominator, at_zero.denominator)
    return int(per_ns * whole), int(at_zero * whole), whole


def waveform_strengths(waveforms: Sequence[Waveform | None], t_ns: np.ndarray) -> np.ndarray:
    """Gives the factors of lights' strengths at instants int64 [n] ns, float64 [n, waveforms]."""
    instants, which = np.unique(t_ns, return_inverse=True)
    each = np.array([[waveform_strength(w, t) for w in waveforms] for t in instants.tolist()])
    return each.reshape(len(instants), len(waveforms))[which.reshape(-1)]


def fixed_vectors(lights: list[Light]) -> np.ndarray:
    """Gives float64 [4, L, 3] in the frames of the lights' bodies: place, axis, half_u, half_v; 0 where a light has
    none.

    Place: unit vector towards a directional light, position of any other. Axis: unit vector along which a spot shines.
    """
    vectors = np.zeros((4, len(lights), 3))
    for index, light in enumerate(lights):
        vector = np.asarray(light.vector, np.float64)
        if light.kind == "directional":
            vectors[0, index] = -vector / np.linalg.norm(vector)
            continue
        vectors[0, index] = vector
        if light.kind == "spot":
            direction = np.asarray(light.direction, np.float64)
            vectors[1, index] = direction / np.linalg.norm(direction)
        elif light.kind == "area":
            vectors[2, index] = np.asarray(light.half_u, np.float64)
            vectors[3, index] = np.asarray(light.half_v, np.float64)
    return vectors


def check_colour(scene: Scene, what: str, colour: Any) -> None:
    """Raises ValueError unless `colour` is three finite numbers of at least 0."""
    values = np.asarray(colour, np.float64)
    if values.shape != (3,) or not np.isfinite(values).all() or (values < 0).any():
        raise ValueError(f"scene {scene.name}: {what} is {values.tolist()}; it must be three numbers of at least 0")


def _cone(light: Light) -> tuple[float, float]:
    """Computes (1 - cos outer, 1 / (cos inner - cos outer)) of a spot light.

    An edge of no width is made 1e-6 of the cosine.
    """
    if light.kind != "spot":
        return 0.0, 0.0
    inner, outer = (2 * np.sin(angle / 2) ** 2 for angle in light.cone)
    return float(outer), float(1 / max(outer - inner, 1e-6 * outer))


def _check(scene: Scene, light: Light) -> None:
    where = f"scene {scene.name}: light '{light.name}'"
    if light.kind not in KINDS:
        raise ValueError(f"{where} is of kind '{light.kind}'; kinds are {', '.join(KINDS)}")
    if not np.isfinite(light.vector).all() or (light.kind == "directional" and not np.any(light.vector)):
        raise ValueError(f"{where} has vector {np.asarray(light.vector).tolist()}; it must be finite and not 0")
    if not WORLD <= light.body < len(scene.bodies):
        raise ValueError(f"{where} is on body {light.body}; the scene has {len(scene.bodies)}")
    check_colour(scene, f"light '{light.name}' colour", light.colour)
    if light.kind == "spot":
        _check_direction(where, "direction", light.direction)
        inner, outer = light.cone
        if not 0 <= inner <= outer <= np.pi or outer == 0:
            raise ValueError(f"{where} has cone {light.cone}; it must be 0 <= inner <= outer <= pi, outer > 0")
    if light.kind == "area":
        u, v = _check_direction(where, "half_u", light.half_u), _check_direction(where, "half_v", light.half_v)
        if abs(u @ v) > 1e-6 * np.linalg.norm(u) * np.linalg.norm(v):
            raise ValueError(f"{where} has half_u {u.tolist()} and half_v {v.tolist()}; they must be perpendicular")
    if light.waveform is not None:
        _check_waveform(where, light.waveform)


def _check_direction(where: str, what: str, vector: Any) -> np.ndarray:
    values = np.asarray(np.nan if vector is None else vector, np.float64)
    if values.shape != (3,) or not np.isfinite(values).all() or not values.any():
        raise ValueError(f"{where} has {what} {values.tolist()}; it must be three finite numbers, not all 0")
    return values


def _check_waveform(where: str, waveform: Waveform) -> None:
    if waveform.kind not in ("sine", "square"):
        raise ValueError(f"{where} has a waveform of kind '{waveform.kind}'; kinds are sine, square")
    numbers = np.array([waveform.frequency, waveform.depth, waveform.phase, waveform.duty])
    if not np.isfinite(numbers).all() or waveform.frequency < 0 or not 0 <= waveform.depth <= 1:
        raise ValueError(f"{where} has {waveform}; the frequency must be at least 0 and the depth 0 ... 1")
    if waveform.kind == "square" and not 0 < waveform.duty <= 1:
        raise ValueError(f"{where} has duty {waveform.duty}; it must be above 0 and at most 1")
