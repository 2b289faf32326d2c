"""Environments whose worlds look different: an interpolator for each world, and their frames as one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.devices import device_named
from evis.scene.worlds import Group
from nodes.interpolator.interpolator import Allocate, Image, Interpolator, new_frames
from nodes.interpolator.keyframe import Report, States


class SeparateInterpolators:
    """Turns keyframes of E environments into frames, in groups of one look each, as Interpolator does.

    What a group's frames are is what they are for the same environments by themselves, bit for bit.
    """

    def __init__(
        self, groups: Sequence[Group], make: Sequence[Callable[[], Interpolator]], upsampling: int, device: str
    ) -> None:
        """groups: scenes, each with its environments. make: the interpolator of each group. upsampling: K, which does
        not adapt to the motion."""
        self.envs = [envs for _, envs in groups]
        self.parts = [make_one() for make_one in make]
        self._upsampling, self._device = upsampling, device_named(device)
        self._episodes = np.zeros(0, np.int32)
        self.report = Report()

    def warm_up_for(self, envs: int, height: int, width: int, margin: int = 0) -> None:
        """Builds and compiles what gaps between such keyframes need, as Interpolator does."""
        for mine, part in zip(self.envs, self.parts):
            part.warm_up_for(len(mine), height, width, margin)

    def warm_up(self) -> None:
        """Compiles the kernels now rather than at the first keyframe."""
        for part in self.parts:
            part.warm_up()

    def push(
        self,
        stamp_ns: int,
        episodes: np.ndarray,
        image: Image,
        depth: Image | None,
        motion: Image | None,
        margin: int = 0,
        allocate: Allocate = new_frames,
        states: States | None = None,
    ) -> tuple[np.ndarray, Any]:
        """Makes the frames of the gap that ends with this keyframe, with arguments and results as of Interpolator."""
        episodes = np.asarray(episodes)
        begins = not len(self._episodes) or bool((episodes != self._episodes).all())
        self._episodes = np.array(episodes)
        count = 1 if begins else self._upsampling
        out: Any = None
        stamps = np.array([stamp_ns])
        self.report = Report()
        for envs, part in zip(self.envs, self.parts):
            own, its_depth, its_motion = (_of(array, envs) for array in (image, depth, motion))
            here = None if states is None else _states_of(states, envs)
            t, frames = part.push(stamp_ns, episodes[envs], own, its_depth, its_motion, margin, self._scratch, here)
            if out is None:
                out = allocate((len(episodes), count, *frames.shape[2:4], *_channels(frames)))
            if len(t) == count:
                stamps = t
            _place(frames, out, envs)
            for item in fields(Report):
                total = getattr(self.report, item.name) + getattr(part.report, item.name)
                setattr(self.report, item.name, total)
        return stamps, out

    def _scratch(self, shape: tuple[int, ...]) -> Any:
        if self._device.is_cpu:
            return new_frames(shape)
        return wp.empty(shape[:4], dtype=wp.vec3 if len(shape) == 5 else wp.float32, device=self._device)


def _channels(frames: Any) -> tuple[int, ...]:
    """What the shape of frames ends in where they are in colour."""
    return (3,) if frames.ndim == 5 or getattr(frames, "dtype", None) is wp.vec3 else ()


def _of(array: Any, envs: np.ndarray) -> Any:
    """The rows of some environments."""
    if array is None:
        return None
    if isinstance(array, np.ndarray):
        return array[envs]
    picked = wp.empty((len(envs), *array.shape[1:]), dtype=array.dtype, device=array.device)
    _rows(array, envs, picked)
    return picked


def _rows(array: wp.array, envs: np.ndarray, to: wp.array) -> None:
    for k, env in enumerate(envs.tolist()):
        wp.copy(to[k : k + 1], array[env : env + 1])


def _states_of(states: States, envs: np.ndarray) -> States:
    rest = None if states.rest is None else states.rest[envs]
    return replace(states, pose=states.pose[envs], twist=states.twist[envs], rest=rest)


def _place(frames: Any, out: Any, envs: np.ndarray) -> None:
    """Copies the frames of a group to their places; those of one that begins an episode hold for the whole gap."""
    count = out.shape[1]
    if isinstance(out, np.ndarray):
        out[envs] = np.broadcast_to(frames, (len(envs), count, *frames.shape[2:]))
        return
    for k, env in enumerate(envs.tolist()):
        for i in range(count):
            wp.copy(out[env : env + 1, i], frames[k : k + 1, min(i, frames.shape[1] - 1)])
