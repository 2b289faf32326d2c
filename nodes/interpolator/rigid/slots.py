"""Brings the bodies of a gap to the slots of a visibility: only what may move is sent."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from evis.scene.model import Scene
from nodes.interpolator.keyframe import States
from nodes.interpolator.rigid import keyframe_kernels
from nodes.interpolator.rigid.placement import Placement
from nodes.renderer.geometry.poses import InstancePoses, of_bodies, same_bytes
from nodes.renderer.raster.visibility import Visibility

HELD = int(keyframe_kernels.HELD)


@dataclass(frozen=True)
class Poses:
    """Holds the poses of a gap: moved float64 [K, E, M, 7], of the bodies `movers` int64 [M]; before and rest float64
    [E, N, 7], of all at the keyframes."""

    moved: np.ndarray
    before: np.ndarray
    rest: np.ndarray
    movers: np.ndarray

    @cached_property
    def changed(self) -> np.ndarray:
        """Tells which numbers of the movers' poses differ at any sub-frame from those before, bool [E, M, 7]."""
        before = of_bodies(self.before, self.movers)
        # One sub-frame after the other: a reduction of all at once goes over memory in large steps.
        gone = np.zeros(before.shape, bool)
        for then in self.moved:
            gone |= then != before
        return gone


class Slots:
    """Brings to the device the `poses` of E environments at the sub-frames of one gap after another: `begin`, then
    `place` each portion."""

    def __init__(self, scene: Scene, visibility: Visibility, placement: Placement, slots: int) -> None:
        """Takes what places the bodies. visibility: of E x slots environments."""
        self._v, self._placement, self._slots = visibility, placement, slots
        self._envs, bodies = visibility.envs // slots, len(scene.bodies)
        self._movers = placement.movers
        self._others = np.setdiff1d(np.arange(bodies), self._movers)
        self._may_move = np.isin(np.arange(bodies), self._movers)
        # Of the other bodies [E, N - M, 7], where they were placed last.
        self._placed: np.ndarray | None = None
        self._b: States | None = None
        self._last: States | None = None
        """The states that were placed last, of the end of a gap."""
        self._others_stay = False
        self._frames: InstancePoses | None = None
        self._none = np.zeros((self._envs, bodies + 2), np.int32)
        place = np.flatnonzero(self._movers == visibility.camera_body)
        self._camera = int(place[0]) if len(place) else None
        self.poses = Poses(np.zeros((0, 0, 0, 7)), np.zeros((0, 0, 7)), np.zeros((0, 0, 7)), np.zeros(0, np.int64))

    def begin(self, stamps: np.ndarray, a: States, b: States, held: np.ndarray, poses: Poses | None = None) -> None:
        """Begins a gap with sub-frames at stamps int64 [K] ns between keyframes a and b; [E, K] where environments
        have times of their own.

        held: bool [E], environments that are at b all along. poses: what `find` gives for it, if it is known. Raises
        ValueError where the states do not reach back to the first stamp.
        """
        # From where the last gap ended nothing moves but what /state says.
        goes_on = a is self._last and not held.any() and b.t[0] == a.t[-1] and b.moving is not None
        self._others_stay = goes_on and bool(self._may_move[b.moving].all())
        self._b = b
        self.poses = self.find(stamps, a, b, held) if poses is None else poses

    def find(self, stamps: np.ndarray, a: States, b: States, held: np.ndarray) -> Poses:
        """Finds the poses of a gap; arguments and errors as of `begin`."""
        moved = self._placement.moved(stamps, b) if stamps.ndim == 1 else self._moved_apart(stamps, b, held)
        if held.any():
            moved[:, held] = moved[-1, held]
        return Poses(moved, a.end_pose, b.end_pose, self._movers)

    def _moved_apart(self, stamps: np.ndarray, b: States, held: np.ndarray) -> np.ndarray:
        """Finds the poses of the movers [K, E, M, 7] in environments whose times differ; b's where they are held."""
        last = of_bodies(b.end_pose, self._movers)
        moved = np.repeat(last[None], stamps.shape[1], axis=0)
        times, which = np.unique(stamps, axis=0, return_inverse=True)
        if self._placement.in_closed_form:
            if stamps.shape[1] > 1 and len(self._movers):
                poses = self._placement.closed_form(times[:, :-1])[which.reshape(-1)]
                moved[:-1, ~held] = poses[~held].swapaxes(0, 1)
            return moved
        self._placement.foresee(times)
        for n, t in enumerate(times):
            envs = np.flatnonzero((which.reshape(-1) == n) & ~held)
            if len(envs):
                moved[:, envs] = self._placement.moved(t, b.part(envs), envs)
        return moved

    def camera(self) -> np.ndarray:
        """Gives poses of the camera float64 [K, E, 7]."""
        if self._camera is not None:
            return self.poses.moved[:, :, self._camera]
        return np.repeat(self.poses.rest[None, :, self._v.camera_body], len(self.poses.moved), 0)

    def still(self, flicker: bool, held: np.ndarray) -> np.ndarray:
        """Gives flags int32 [E, N + 2] of `keyframe_kernels.find_unchanged`; flicker: whether light changes."""
        rest, before = self.poses.rest, self.poses.before
        rests = (self.camera() == before[:, self._v.camera_body]).all(axis=(0, 2))
        if not rests.any() and not held.any():
            return self._none
        flags = np.zeros_like(self._none)
        if rests.any():
            still = np.ones(rest.shape[:2], bool)
            if not self._others_stay:
                still = (rest == before).all(axis=-1)
            still[:, self._movers] = ~self.poses.changed.any(axis=2)
            lit = rests & (not flicker)
            flags[:, :-2] = still & lit[:, None]
            # What emits no light changes with the lamps, but the sky does not.
            flags[:, -2], flags[:, -1] = lit, rests
        flags[held] = HELD
        return flags

    def place(self, which: list[int]) -> InstancePoses:
        """Places the sub-frames `which`, counted from 0, one of each slot; on a GPU they are there after `arrive`."""
        self._last = self._b
        fresh = self.poses.moved[which].reshape(self._v.envs, len(self._movers), 7)
        if not self._others_stay:
            others = of_bodies(self.poses.rest, self._others)
            if self._frames is None or self._placed is None or not same_bytes(others, self._placed):
                poses = np.tile(self.poses.rest, (self._slots, 1, 1))
                poses[:, self._movers] = fresh
                return self._place_all(poses, others)
        if len(self._movers):
            self._frames = self._v.send(fresh)
        assert self._frames is not None
        return self._frames

    def place_before(self) -> InstancePoses:
        """Places keyframe a in all slots."""
        return self._place_all(
            np.tile(self.poses.before, (self._slots, 1, 1)), of_bodies(self.poses.before, self._others)
        )

    def _place_all(self, poses: np.ndarray, others: np.ndarray) -> InstancePoses:
        self._placed, self._frames = others, self._v.instance_poses(poses)
        self._v.place(self._frames)
        return self._frames
