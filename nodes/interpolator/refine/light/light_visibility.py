"""Finds shadows, beams and lamps that pass between two frames: how often to test for them, and at which parts pixels
change."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.exchange import cpu_array
from evis.runtime.workers import edges_of
from nodes.interpolator.refine.evaluation.evaluator import Evaluator, changes_of
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.light.assemblies import Assemblies, thinnest_between
from nodes.interpolator.refine.light.box_shadows import BoxShadows
from nodes.interpolator.refine.light.facets import BOXES, FEWEST, Facets
from nodes.interpolator.refine.light.lamp_turns import LampTurns
from nodes.interpolator.refine.light.light_visibility_kernels import make_find_light_changes
from nodes.interpolator.refine.light.passing_lamps import PassingLamps
from nodes.interpolator.refine.light.shadow_time_kernels import find_shortest_oscillations, find_shortest_shadows
from nodes.interpolator.refine.light.silhouettes import finest_halves
from nodes.interpolator.refine.probing.boxes import boxes_of
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.lights.lights import fixed_vectors
from nodes.renderer.shadows.boxes import half_extents

MOST = 64
"""Parts of a coarse interval, at most: as many as a number has bits."""
SEEN = 0.8
"""Length of a part, of the time for which the thinnest shadow is on a point: then it is seen in one of them."""
ROUND = 0.5
"""What a beam's width counts: it is round, and on a seventh of the points that it passes for less than half as long as
on those in its middle."""
LOOKED_AT_NS, LOOKS, SHORT_NS, USUAL_NS = 2_000_000_000, 33, 50_000, 10_000_000
"""Time of prescribed motion that is looked at beforehand, at so many places, how long at each, and the longest coarse
interval that is usual: 8.3 ms at 30 keyframes per second."""
FALL = 4.0
"""Distance at which shadows under a light far away fall, of the radius of the largest thing."""
PER_TURN, LOOKED_FOR, TURNED = 3, 64, 0.25
"""Parts of the time between two turns of what goes to and fro, instants of a gap at which it is looked for, and how far
it has to go [px]."""
PER_FACET, FEW = 32, 1.5
"""Looks while a facet is on a point, which the lamp may leave alone for any part of that time, and so many at least:
with fewer it is not looked for."""
SOFT = 4
"""Looks in that time under a light with an area, where a shadow is at its darkest for a part of it alone."""


class LightVisibility:
    """Finds when lamps stop or begin to light what pixels see: `bits` uint64 [intervals E, h, w] of one window after
    another, as of find_light_changes.

    Only where a shadow of something thin and fast, a beam that turns, or a lamp that goes to and fro, may be gone again
    before the next look: half a coarse interval is close enough for all others.
    """

    def __init__(self, rigid: Rigid) -> None:
        v, movers = rigid.visibility, rigid.placement.movers
        scene, geometry = v.scene, v.geometry
        self._rigid, self._changes = rigid, changes_of(rigid)
        half, not_camera = half_extents(v), geometry.body != v.camera_body
        moving = np.isin(geometry.body, movers) & not_camera
        places, axes, *_ = fixed_vectors(scene.lights)
        carried = [l for l, light in enumerate(scene.lights) if light.body in movers]
        lamps = [l for l in carried if scene.lights[l].shadows]
        # What stands still counts under a lamp that moves alone.
        asked = moving | bool(lamps) if self._changes.covers else np.zeros_like(moving)
        fine = finest_halves(v, asked)
        self._boxes, self._count = boxes_of(v, movers, np.flatnonzero(moving), fine)
        self._assemblies = Assemblies(v, movers, np.flatnonzero(moving & asked), rigid.placement.worlds)
        self._box_shadows = BoxShadows.of(v, movers, np.flatnonzero(moving & asked), fine)
        self._facets = Facets(v, movers, moving & self._changes.facets)
        self._lamp_turns = LampTurns(v, movers)
        self._passing_lamps = PassingLamps(v, movers)
        self._lamp_mover = np.searchsorted(movers, [scene.lights[l].body for l in lamps]).astype(np.int64)
        # A light far away sweeps over what throws shadows as one does that is as far as these may fall.
        solid = float(geometry.radius[(half > 0).all(axis=1)].max(initial=0.0))
        far = FALL * (solid or float(geometry.radius[moving].max(initial=0.0)) or 1.0)
        self._lamps = np.array([places[l] * (far if scene.lights[l].kind == "directional" else 1.0) for l in lamps])
        self._fixed = np.array([scene.lights[l].kind == "directional" for l in lamps], bool)
        beams = [l for l in carried if scene.lights[l].kind == "spot"]
        self._beam_mover = np.searchsorted(movers, [scene.lights[l].body for l in beams]).astype(np.int64)
        self._beams, self._cones = axes[beams], np.array([2 * ROUND * scene.lights[l].cone[1] for l in beams])
        still = np.flatnonzero(~moving & asked & not_camera & bool(lamps))
        self._still_box_shadows = BoxShadows.of(v, movers, still, fine, still=True)
        self._thinnest = self._thinnest_far = self._thinnest_still(moving, fine, still, np.ones(len(fine)))
        if self._fixed.any():
            # The shadow of what is flat falls farther where that is larger than all that is not.
            nearer = far / (FALL * np.maximum(geometry.radius.astype(np.float64), max(solid, 1e-30)))
            self._thinnest_far = self._thinnest_still(moving, fine, still, nearer)
        self._near = TURNED / max(v.view.fx, v.view.fy)
        self._looks = SOFT if any(light.kind == "area" and light.shadows for light in scene.lights) else 1
        self.bits = wp.empty((0, 0, 0), dtype=wp.uint64, device=v.device)

    def _thinnest_still(self, moving: np.ndarray, fine: np.ndarray, still: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Gives the width of the thinnest thing that stands still, or gap between such, float64 [1 or E] m, each as
        much wider as `scale` [I] says."""
        widths = scale[~moving] * np.sort(fine[~moving], axis=1)[:, 1]
        thinnest = np.full(1, widths[widths > 0].min(initial=np.inf)) * 2
        if not len(still):
            return thinnest
        worlds = self._rigid.placement.worlds
        return np.minimum(thinnest, thinnest_between(self._rigid.visibility, still, worlds, scale))

    @cached_property
    def kernel(self) -> wp.Kernel:
        """Returns the kernel that finds them, made when it is first asked for."""
        return make_find_light_changes(self._changes, self._rigid.shading.occluders.trees)

    def likely(self) -> bool:
        """Predicts whether gaps will have such shadows, as far as prescribed motion tells; beside a GPU, where a kernel
        takes up to twenty seconds to compile, there are cores enough to be ready in any case."""
        if not self._changes.passes and not self._facets.any:
            return False
        v, movers = self._rigid.visibility, self._rigid.placement.movers
        if v.device.is_cuda:
            return True
        times = np.linspace(0, LOOKED_AT_NS, LOOKS).astype(np.int64)[:, None] + np.array([0, SHORT_NS])
        poses = np.broadcast_to(se3.IDENTITY, (*times.shape, 1, len(v.scene.bodies), 7)).copy()
        for n, path in enumerate(body.trajectory for body in v.scene.bodies):
            if path is not None:
                poses[:, :, 0, n] = path.pose(times.ravel()).reshape(*times.shape, 7)
        apart, usual = np.array([SHORT_NS]), np.array([USUAL_NS])
        # What of a facet is seen is up to where the camera is then.
        looks = [
            min(seen[0] for seen in self._looks_apart(pair[:, :, movers], pair[0], apart, usual)) for pair in poses
        ]
        return bool(min(looks) * 2 < USUAL_NS)

    def parts(
        self, instants: Instants, poses: Poses, lengths: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Computes into how many parts a coarse interval is divided to look for shadows and beams that pass, and for
        facets, int [2, E].

        Powers of two; 0 where half of one will do. Also, bool [E], where some of these are too thin and fast to be seen
        at each.

        poses: at all instants of the gap. lengths: of the gap, int64 [E] ns. held: bool [E], who has none.
        """
        if not self._changes.passes and not self._facets.any:
            return np.zeros((2, len(held)), np.int64), np.zeros(len(held), bool)
        lengths = np.where(held, 1, lengths)
        coarse = lengths / instants.coarse
        most = min(MOST, 1 << instants.depth)
        found, missed = [], []
        apart = self._looks_apart(poses.moved, poses.rest, lengths / instants.count, coarse)
        for seen, longest in zip(apart, (1.0, PER_FACET / FEW)):
            rare = ~held & (2 * seen < coarse)
            wanted = np.ceil(coarse / np.maximum(seen, coarse / (most + 1)))
            parts = np.minimum(1 << np.ceil(np.log2(np.maximum(wanted, 1))).astype(np.int64), most)
            found.append(np.where(rare & (parts > 2), parts, 0))
            missed.append(rare & (np.ceil(coarse / np.maximum(longest * seen, coarse / (most + 1))) > most))
        found[1][missed[1]] = 0
        return np.stack(found), missed[0] | missed[1]

    def find(self, intervals: int, params: Any, scene: Any, evaluator: Evaluator) -> None:
        """Finds the bits of a window whose bodies are placed: launches only. intervals: of the window."""
        v, sampling = evaluator.visibility, self._rigid.sampling
        edges = edges_of(params.height, evaluator.bands)
        span = params.width if v.device.is_cpu else 1
        launches: list[tuple[wp.Kernel, Any, list[Any]]] = []
        for low, high in pairwise(edges):
            lit = [scene, evaluator.change, self._facets.normal_deviation, self.bits]
            given = [v.view, params, low, span, *lit]
            launches.append((self.kernel, (intervals * params.envs, high - low, params.width // span), given))
        sampling.launch(launches)

    def make_room(self, intervals: int, params: Any) -> None:
        """Makes room for the bits of a window."""
        shape = (intervals * params.envs, params.height, params.width)
        if self.bits.shape != shape:
            self.bits = wp.zeros(shape, dtype=wp.uint64, device=self._rigid.visibility.device)

    def _looks_apart(
        self, moved: np.ndarray, rest: np.ndarray, apart_ns: np.ndarray, coarse_ns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gives how far apart looks may be, float64 [E] ns: at shadows, beams and lamps, and at facets; as of
        `_shortest`."""
        none = np.full(moved.shape[1], np.inf)
        shadows = SEEN * self._shortest(moved, rest, apart_ns, coarse_ns) if self._changes.passes else none
        if self._lamp_turns.any and len(moved) > 2:
            turned = apart_ns * self._lamp_turns.shortest(moved, rest) / PER_TURN
            shadows = np.minimum(shadows, SEEN * turned)
        if not self._facets.any or len(moved) < 2:
            return shadows, none
        return shadows, self._facets.shortest(moved, rest, apart_ns) / PER_FACET

    def _shortest(self, moved: np.ndarray, rest: np.ndarray, apart_ns: np.ndarray, coarse_ns: np.ndarray) -> np.ndarray:
        """Gives the shortest time, float64 [E] ns, for which the light of a lamp that goes by is on a point, or the
        shadow of something, or the light through a hole in it, its width over its speed with the lamp's, or that of
        what goes to and fro, or a beam that turns; a part of that under area lights.

        moved: poses of the movers at all instants, float64 [n, E, M, 7], apart_ns [E] from each other. rest: of
        all bodies, float64 [E, N, 7]. coarse_ns: the coarse interval [E], at half
        of which all is looked at in any case.
        """
        envs, most = moved.shape[1], len(moved) - 1
        shine, shortest = np.zeros(envs), np.full(envs, np.inf)
        if most < 1:
            return shortest
        if self._passing_lamps.any:
            longest = coarse_ns / (2 * SEEN) * self._looks / apart_ns
            shortest = self._passing_lamps.shortest(moved, rest, longest)
        if not self._changes.covers:
            return apart_ns * shortest / self._looks
        times = min(most, max(FEWEST, BOXES // max(self._count, 1)))
        first = np.linspace(0, most - 1, times).astype(np.int32)
        if len(self._lamps):
            before, after = (moved[first + k][:, :, self._lamp_mover] for k in (0, 1))
            before[:, :, self._fixed, :3] = after[:, :, self._fixed, :3] = 0.0
            way = se3.transform(after, self._lamps) - se3.transform(before, self._lamps)
            ways = np.linalg.norm(way, axis=-1).max(axis=0)
            shine = ways.max(axis=1)
            thinnest = np.where(self._fixed, self._thinnest_far[:, None], self._thinnest[:, None])
            shortest = np.minimum(shortest, (thinnest / np.maximum(ways, 1e-30)).min(axis=1))
        if len(self._beams):
            before, after = (moved[first + k][:, :, self._beam_mover, 3:] for k in (0, 1))
            apart = np.linalg.norm(se3.rotate(after, self._beams) - se3.rotate(before, self._beams), axis=-1)
            turned = 2 * np.arcsin(np.minimum(apart / 2, 1.0))
            shortest = np.minimum(shortest, (self._cones / np.maximum(turned, 1e-30)).min(axis=(0, 2)))
        for shadows_of in (self._box_shadows, self._still_box_shadows):
            if shadows_of.any:
                shortest = np.minimum(shortest, shadows_of.shortest(moved, rest, first))
        if self._count:
            eye = rest[:, self._rigid.visibility.camera_body]
            poses = cpu_array(np.ascontiguousarray(moved), wp.transformd)
            found, turns = np.empty((times, envs, self._count)), np.empty((envs, self._count))
            given = [self._boxes, cpu_array(shine), cpu_array(first), poses]
            wp.launch(find_shortest_shadows, found.shape, given, [cpu_array(found)], device="cpu")
            given = [self._boxes, max(1, len(moved) // LOOKED_FOR), wp.float64(self._near)]
            given += [cpu_array(np.ascontiguousarray(eye), wp.transformd), poses]
            wp.launch(find_shortest_oscillations, turns.shape, given, [cpu_array(turns)], device="cpu")
            # A shadow's edge is on most points that it comes over for a part of the time between two turns.
            turned = turns.min(axis=1) / PER_TURN
            shortest = np.minimum(shortest, np.minimum(found.min(axis=(0, 2)), turned))
        if self._assemblies.any:
            shortest = np.minimum(shortest, self._assemblies.shortest(shine, first, moved, rest))
        return apart_ns * shortest / self._looks
