"""Interpolates environments whose worlds look different: an interpolator for each world, and their frames as one
batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.devices import device_named
from evis.scene.parts import Parts
from evis.scene.worlds import Group
from nodes.interpolator.interpolator import Image, Interpolator
from nodes.interpolator.keyframe import Report, States
from nodes.interpolator.pixel_means import Allocate, new_frames, new_frames_on
from nodes.interpolator.samples import Further, joined

NOBODY = 1 << 20
"""Added to the number of an episode, for it to be another one."""


class SeparateInterpolators:
    """Turns keyframes of E environments into frames, in groups of one look each, as Interpolator does.

    What a group's frames are is what they are for the same environments by themselves, bit for bit.
    """

    def __init__(self, parts: Parts[Interpolator], upsampling: int, device: str) -> None:
        """Takes the interpolators. parts: interpolators for all of them, one that has seen keyframes, or new ones.
        upsampling: K, which does not adapt to the motion."""
        self._parts = parts
        self._upsampling, self._device = upsampling, device_named(device)
        self._stamp, self._episodes = parts.all[0].last
        self.report = Report()
        self.own_t: np.ndarray | None = None
        self.further: Further | None = None

    def change(self, groups: Sequence[Group], make: Sequence[Callable[[], Interpolator]]) -> list[Interpolator]:
        """Gives environments whose worlds are others from now on interpolators of their own, by group."""
        return self._parts.change(groups, make)

    @property
    def late(self) -> bool:
        """Tells whether reports come a gap late, as those of Interpolator may."""
        return any(part.late for part in self._parts.all)

    def last_report(self) -> Report:
        """Gives the report of the last gap of those whose reports come late, once."""
        return sum((part.last_report() for part in self._parts.all), Report())

    def forget(self) -> None:
        """Forgets the last keyframe, as Interpolator does."""
        for part in self._parts.all:
            part.forget()
        self._stamp, self._episodes = 0, np.zeros(0, np.int32)

    def warm_up_for(self, envs: int, height: int, width: int, margin: int = 0, gap_ns: int = 0) -> None:
        """Builds and compiles what gaps between such keyframes need, as Interpolator does."""
        for part in self._parts.parts:
            part.made.warm_up_for(len(part.envs), height, width, margin, gap_ns)

    def warm_up(self) -> None:
        """Compiles the kernels now rather than at the first keyframe."""
        for part in self._parts.all:
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
        own: np.ndarray | None = None,
    ) -> tuple[np.ndarray, Any]:
        """Makes the frames of the gap that ends with this keyframe, with arguments and results as of Interpolator."""
        episodes = np.asarray(episodes)
        begun = np.ones(len(episodes), bool) if not len(self._episodes) else episodes != self._episodes
        again = bool(len(self._episodes)) and stamp_ns == self._stamp
        self._episodes, self._stamp = np.array(episodes), stamp_ns
        count = 1 if again or begun.all() else self._upsampling
        out: Any = None
        stamps = np.array([stamp_ns])
        self.report = Report()
        self.own_t = None if own is None else np.repeat(own[:, None], count, axis=1)
        found: list[tuple[np.ndarray, np.ndarray, Further | None]] = []
        for part in self._parts.parts:
            mine, live, interpolator = part.inputs, part.live, part.made
            its_image, its_depth, its_motion = (_of(array, mine) for array in (image, depth, motion))
            if again and not begun[part.envs[live]].any():
                # The message is of others alone.
                t, frames = stamps, interpolator.shown(its_image, margin, self._scratch)
            else:
                here = None if states is None else _states_of(states, mine)
                # What stands in the place of one that has left is of an episode that it was not in.
                numbers = np.where(live, episodes[mine], episodes[mine] + NOBODY)
                its = None if own is None else own[mine]
                t, frames = interpolator.push(
                    stamp_ns, numbers, its_image, its_depth, its_motion, margin, self._scratch, here, its
                )
                if self.own_t is not None and interpolator.own_t is not None:
                    self.own_t[part.envs[live]] = interpolator.own_t[live]
                self.report += interpolator.report
                found.append((part.envs[live], np.flatnonzero(live), interpolator.further))
            if out is None:
                out = allocate((len(episodes), count, *frames.shape[2:4], *_channels(frames)))
            if len(t) == count:
                stamps = t
            _place(frames, out, part.envs, live)
        self.further = joined(found, len(episodes), out.shape[2] * out.shape[3], self._device)
        return stamps, out

    def _scratch(self, shape: tuple[int, ...]) -> Any:
        return new_frames_on(self._device, shape)


def _channels(frames: Any) -> tuple[int, ...]:
    """Gives what the shape of frames ends in: (3,) where they are in colour, else nothing."""
    return (3,) if frames.ndim == 5 or getattr(frames, "dtype", None) is wp.vec3 else ()


def _of(array: Any, envs: np.ndarray) -> Any:
    """Selects the rows of some environments."""
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
    rest, own_t = (None if array is None else array[envs] for array in (states.rest, states.own_t))
    return replace(states, pose=states.pose[envs], twist=states.twist[envs], rest=rest, own_t=own_t)


def _place(frames: Any, out: Any, envs: np.ndarray, live: np.ndarray) -> None:
    """Copies the frames of those of a group that are live to their places; of one that begins an episode there is one,
    which holds for the whole gap."""
    count = out.shape[1]
    if isinstance(out, np.ndarray):
        out[envs[live]] = np.broadcast_to(frames, (len(envs), count, *frames.shape[2:]))[live]
        return
    for k in np.flatnonzero(live).tolist():
        env = int(envs[k])
        for i in range(count):
            wp.copy(out[env : env + 1, i], frames[k : k + 1, min(i, frames.shape[1] - 1)])
