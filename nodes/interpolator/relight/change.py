"""Holds lights and casters at the keyframes and in between, and finds which bodies of a scene they may change the light
on."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.media.colour import REC709
from evis.scene.model import Light, Scene
from nodes.interpolator.relight import change_kernels, swept_kernels
from nodes.interpolator.relight.boxes_kernels import Swept
from nodes.interpolator.relight.features import LightChanges, light_changes
from nodes.interpolator.relight.light_kernels import MANY
from nodes.interpolator.relight.sweep import Sweep
from nodes.renderer.geometry.poses import of_bodies
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.lighting import Shading
from nodes.renderer.lights.lights import KINDS, fixed_vectors
from nodes.renderer.materials.ggx import alpha_of, is_plain
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents
from nodes.renderer.shadows.ray_kernels import Casters

if TYPE_CHECKING:
    from nodes.interpolator.rigid.slots import Poses

MOVED, SHADED = int(change_kernels.MOVED), int(change_kernels.SHADED)
LIT_ANEW, AROUND = int(change_kernels.LIT_ANEW), int(change_kernels.AROUND)
BEYOND, WITHIN = 0.02, 37
"""Part of its way by which what moves goes beyond where it is at the frames, between them, at most, where these tell;
instants of a gap at which that is asked, at most: a number that no swing of so many frames is back at."""
BLURRED = 2.0
"""Distance [px] from a shadow's edge up to which a look-up in a keyframe mixes both sides of it."""


class LightChange:
    """Holds what kernels need to tell where light changes in a gap: `kernel`, of `features`.

    For E environments of a visibility with E x slots; keyframes have at most 2 E rows.
    """

    def __init__(
        self,
        shading: Shading,
        envs: int,
        movers: np.ndarray,
        features: LightChanges,
        tolerance: float,
        in_a_row: bool = False,
    ) -> None:
        """Takes the shading of the keyframes. movers: bodies that may move, int64 [M]. tolerance: of ln I. in_a_row:
        whether keyframe B of an environment is A of the next."""
        v = self._v = shading.visibility
        scene: Scene = shading.scene
        self.features, self._envs, self._movers, self._scene = features, envs, movers, scene
        self._bodies = len(scene.bodies)
        self._lamps = np.array(sorted({l.body for l in scene.lights} & set(movers.tolist())), np.int64)
        turning_only = {l.kind for l in scene.lights} <= {"directional"} and not any(l.shadows for l in scene.lights)
        # A body that moves without turning keeps the light of a lamp far away.
        self._columns = slice(3, 7) if turning_only and scene.environment_map is None else slice(0, 7)
        self._lights = shading.lights
        rows = 2 * envs
        self._to_b = 1 if in_a_row else envs
        change = self.kernel = change_kernels.Change()
        change.now, change.then = shading.lights.kernel, shading.lights.elsewhere(rows)
        change.sky, change.casters = shading.sky, shading.occluders.casters
        change.casters_then = self._casters_then(change.casters, rows)
        change.eye_then, change.place_then = v.empty(rows, wp.mat33), v.empty(rows, wp.vec3)
        change.flags = wp.zeros((envs, self._bodies + 1), dtype=wp.int32, device=v.device)
        change.instance, change.normals = shading.surfaces.instance, shading.normals
        change.alpha = v.put(np.array([alpha_of(scene.materials[i.material]) for i in scene.instances]), wp.float32)
        change.least = min(
            (a for i in scene.instances if (a := alpha_of(scene.materials[i.material])) >= 0), default=1.0
        )
        half = half_extents(v)
        change.half = v.put(half, wp.vec3)
        change.weight = v.put(np.array([l.colour for l in scene.lights]).reshape(-1, 3) @ REC709, wp.float32)
        plain = [is_plain(scene.materials[i.material]) for i in scene.instances]
        dark = [not np.any(scene.materials[i.material].emission) for i in scene.instances]
        change.carried = v.put(np.logical_and(plain, dark).astype(np.int32), wp.int32)
        change.even, change.bend, change.turned = 0.25 * tolerance, 0.03 * tolerance, 2.0 * float(np.sqrt(tolerance))
        change.blur = BLURRED / min(v.view.fx, v.view.fy)
        self._flags = np.zeros(change.flags.shape, np.int32)
        on_movers = {i.material for i in scene.instances if i.body in movers}
        self._glows = any(np.any(scene.materials[m].emission) for m in on_movers)
        self._positional = np.array([l.kind != "directional" for l in scene.lights], bool)
        self._sweep, self._sweep_between = Sweep(v, envs, movers, half), Sweep(v, envs, movers, half)
        self._sweep_between.lower, self._sweep_between.upper = self._sweep.lower, self._sweep.upper
        # Of the movers, those that carry a lamp or a caster.
        self._telling = np.union1d(np.searchsorted(movers, self._lamps), self._sweep.casters).astype(np.int64)
        self._origin: np.ndarray | None = None
        change.swept = self._make_swept()
        few = features.shadows and change.casters.order.size <= MANY and not len(self._lamps)
        change.open = wp.zeros((envs if few else 0, len(v.geometry.body)), dtype=wp.int32, device=v.device)
        self._swept_bodies = v.put(self._sweep.bodies, wp.int32)

    def take(self, first: int, poses: wp.array) -> None:
        """Notes where lights and casters are at keyframes of a pair from row `first` on, for poses transformd [rows,
        N]: launches only."""
        mine, change = slice(first, first + poses.shape[0]), self.kernel
        self._lights.place(poses, change.then, mine)
        casters = change.casters_then
        self._v.place_at(poses, casters.rotation[mine], casters.translation[mine], change.eye_then[mine])
        self._place_cameras(poses, change.place_then[mine])

    def begin(self, poses: Poses, still: np.ndarray) -> np.ndarray:
        """Finds which bodies' light may change in a gap, and sends that to the device.

        Args:
            poses: of the gap.
            still: flags of `keyframe_kernels.find_unchanged`, int32 [E, N + 2].

        Returns:
            `still` without those whose light a lamp may change at any pixel.
        """
        flags = self._send(poses, self._sweep)
        changed = (flags & (MOVED | LIT_ANEW)) != 0
        if not changed.any():
            return still
        result = still.copy()
        result[:, :-1][changed & (still[:, :-1] == 1)] = 0
        return result

    def widen(self, frames: Poses, instants: Poses) -> None:
        """Takes the instants of the gap that has begun into account, for looks between its frames, where something goes
        farther there than at the frames: what swings may be back, or nearly, at every frame."""
        count = len(instants.moved)
        which = np.linspace(0, count - 1, min(count, WITHIN)).astype(np.int64)
        some = replace(instants, moved=instants.moved[which])
        (low, high), (lowest, highest) = (self._reach_of(poses) for poses in (frames, some))
        margin = BEYOND * (highest - lowest)
        if ((lowest < low - margin) | (highest > high + margin)).any():
            self._send(some, self._sweep_between)
            self._find_shaded()

    def _reach_of(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Gives the least and the greatest coordinates of what carries lamps and casters in a gap, float64 [E, C, 3] m
        each."""
        before = of_bodies(poses.before, self._movers)[:, self._telling, :3]
        moved = poses.moved[:, :, self._telling, :3]
        return np.minimum(moved.min(axis=0), before), np.maximum(moved.max(axis=0), before)

    def _send(self, poses: Poses, sweep: Sweep) -> np.ndarray:
        """Sends flags and boxes for the poses of a gap, and returns the flags."""
        flags = self._flags_of(poses.changed)
        if not np.array_equal(flags, self._flags):
            self.kernel.flags.assign(flags)
            self._flags = flags
        if (flags & (SHADED | AROUND)).any() or (self.kernel.open.size and (flags & MOVED).any()):
            sweep.send(poses.moved, of_bodies(poses.before, self._movers), self._origin_of())
        return flags

    def place(self) -> None:
        """Notes where the cameras of the slots are: a launch only."""
        self.place_beside(self._v, self.kernel)

    def place_beside(self, v: Visibility, kernel: Any) -> None:
        """Notes where the cameras of the slots of another visibility are, in the struct of `beside`: a launch only."""
        self._place_cameras(v.poses, kernel.swept.place)

    def _place_cameras(self, poses: wp.array, place: wp.array) -> None:
        """Notes where the cameras are for poses transformd [rows, N], vec3 [rows]: a launch only."""
        given = [poses, self._v.camera_body, wp.vec3d(*self._origin_of())]
        wp.launch(swept_kernels.place_cameras, poses.shape[0], given, [place], device=self._v.device)

    def beside(self, shading: Shading) -> Any:
        """Makes the kernels' struct of the same gaps for the slots of another shading of the scene."""
        other: Any = change_kernels.Change()
        for name in ("then", "casters_then", "eye_then", "place_then", "flags", "open", "instance", "normals", "alpha"):
            setattr(other, name, getattr(self.kernel, name))
        for name in ("half", "weight", "carried", "least", "even", "bend", "turned", "blur"):
            setattr(other, name, getattr(self.kernel, name))
        other.now, other.sky, other.casters = shading.lights.kernel, shading.sky, shading.occluders.casters
        swept = Swept()
        for name in ("lower", "upper", "size", "lamp", "radius", "kind", "masks", "blur"):
            setattr(swept, name, getattr(self.kernel.swept, name))
        swept.place = shading.visibility.empty(shading.visibility.envs, wp.vec3)
        other.swept = swept
        return other

    def exclude_relit(self, pieces: wp.array, unchanged: wp.array) -> None:
        """Finds what may be shaded in the gap that has begun, and takes that from what is unchanged [E, H, W], keyframe
        B being in the first slot: launches only."""
        v = self._v
        self._find_shaded()
        dim = (self._envs, v.shape[1], v.shape[2] // v.span)
        wp.launch(swept_kernels.exclude_relit, dim, [v.view, v.span, self.kernel, pieces, unchanged], device=v.device)

    def _find_shaded(self) -> None:
        """Finds what may be shaded in the gap that has begun: launches only."""
        v = self._v
        if self.features.shadows:
            masks = self.kernel.swept.masks
            wp.launch(swept_kernels.find_shaded, masks.shape[:2], [self.kernel], [masks], device=v.device)
        if (found := self.kernel.open).size:
            given = [self.kernel, self._to_b, self._swept_bodies]
            wp.launch(swept_kernels.find_open, found.shape, given, [found], device=v.device)

    def _flags_of(self, gone: np.ndarray) -> np.ndarray:
        """Computes the flags int32 [E, N + 1] of bodies and the world; gone: see Poses."""
        relative = np.zeros((self._envs, self._bodies + 1), bool)
        relative[:, self._movers] = gone[..., self._columns].any(-1)
        # A camera that moves changes no light.
        anything: np.ndarray = np.any(gone[:, self._telling], axis=(1, 2), keepdims=True)[:, 0, 0]
        # Also while a lamp on something that may move rests: sweeps are told for those alone that never move.
        if len(self._lamps):
            relative[anything] = True
        tells = self.features.relative or self.features.view
        flags = np.where(relative, MOVED, 0) if tells else np.zeros(relative.shape, np.int64)
        if self.features.shadows:
            flags = np.where(relative, flags, np.where(anything[:, None], SHADED, 0))
        if self.features.indirect:
            lit = relative | (anything & self._glows)[:, None]
            flags = flags | np.where(lit, LIT_ANEW, np.where(anything[:, None], AROUND, 0))
        return flags.astype(np.int32)

    def _still_lamps(self) -> np.ndarray:
        """Places of lights that stand still, float64 [L, 3] in the world, or unit vectors towards those far away."""
        vectors = fixed_vectors(self._scene.lights)[0]
        for k, light in enumerate(self._scene.lights):
            path = self._scene.bodies[light.body].trajectory if light.body >= 0 else None
            if path is not None:
                pose = path.pose(np.zeros(1, np.int64))[0]
                vectors[k] = se3.to_matrix(se3.normalize(pose[3:])) @ vectors[k]
                vectors[k] += pose[:3] if self._positional[k] else 0.0
        return vectors

    def _origin_of(self) -> np.ndarray:
        """Chooses the point that sweeps are told about, float64 [3] m: where lights and things that stand still are not
        far."""
        if self._origin is None:
            places = self._still_lamps()[self._positional]
            self._origin = places.mean(0) if len(places) else np.zeros(3)
        return self._origin

    def _make_swept(self) -> Any:
        v, swept = self._v, Swept()
        # No light without shadows is asked about.
        casting = [k for k, light in enumerate(self._scene.lights) if light.shadows]
        lights = [self._scene.lights[k] for k in casting]
        swept.lower, swept.upper = self._sweep.lower, self._sweep.upper
        swept.place = v.empty(v.envs, wp.vec3)
        swept.blur = 0.0 if is_static(self._scene, v.camera_body) else self.kernel.blur
        swept.size = v.put(self._sweep.size, wp.float32)
        lamps = self._still_lamps()
        lamps[self._positional] -= self._origin_of()
        swept.lamp = v.put(lamps[casting], wp.vec3)
        swept.radius = v.put(np.array([_extent(light) for light in lights]), wp.float32)
        swept.kind = v.put(np.array([KINDS[light.kind] for light in lights], np.int32), wp.int32)
        swept.masks = v.empty((self._envs, len(self._v.geometry.body), len(lights)), wp.uint32)
        return swept

    def _casters_then(self, now: Any, rows: int) -> Any:
        """Makes the struct of casters with places of their own, for the keyframes."""
        then, count = Casters(), len(self._v.geometry.body)
        for name in ("mesh", "radius", "shell", "box", "outer", "core", "order", "still", "is_still"):
            setattr(then, name, getattr(now, name))
        then.rotation, then.translation = self._v.empty((rows, count), wp.mat33), self._v.empty((rows, count), wp.vec3)
        return then


def _extent(light: Light) -> float:
    """Computes the radius of a ball about an area light's middle that holds it [m], 0 of other lights."""
    if light.kind != "area" or light.half_u is None or light.half_v is None:
        return 0.0
    return float(np.linalg.norm(light.half_u) + np.linalg.norm(light.half_v))


def make_light_change(
    shading: Shading, envs: int, movers: np.ndarray, tolerance: float, paths: bool, in_a_row: bool
) -> LightChange | None:
    """Makes the LightChange of a scene, or None where nothing in it can change the light."""
    visibility: Visibility = shading.visibility
    features = light_changes(shading.scene, visibility.camera_body, paths)
    return LightChange(shading, envs, movers, features, tolerance, in_a_row) if features.any else None
