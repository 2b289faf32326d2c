"""Makes the frames of several gaps between keyframes at once, where nobody waits for each gap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.in_a_row import joined
from evis.runtime.clock import subframe_stamps
from nodes.interpolator import warm_up as made_up
from nodes.interpolator.interpolator import Allocate, Image, Interpolator, new_frames
from nodes.interpolator.keyframe import KeyframeView, Report, States, StatesInARow
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid
from nodes.interpolator.samples import Further


@dataclass
class Arrived:
    """Holds a keyframe of one environment, with the arguments of `Interpolator.push`."""

    stamp_ns: int
    episodes: np.ndarray
    image: Image
    states: States | None


class ManyGaps(Interpolator):
    """Makes the frames of up to `gaps` consecutive gaps at once, bit for bit as one by one.

    The gaps are given to the method as environments with times of their own. For method rigid and one environment.
    gaps: 1 where the scene does not allow more.
    """

    def __init__(self, method: str, upsampling: int, gaps: int, **how: Any) -> None:
        """how: as of Interpolator."""
        super().__init__(method, upsampling, **how)
        self.gaps = gaps
        self._rigid: tuple[Any, Rigid | Refined] | None = None
        """The method for several gaps, and the image size ((E, H, W), margin) that it was made for."""
        self._row: tuple[KeyframeView, KeyframeView] | None = None
        """Views B of the gaps made last, and the last of these views by itself."""
        self.further_of: list[Further | None] = []
        """Samples of single pixels between the frames of each gap of the list that was yielded last."""

    def push_all(
        self, keyframes: Sequence[Arrived], margin: int = 0, allocate: Allocate = new_frames
    ) -> Iterator[list[tuple[np.ndarray, Any]]]:
        """Yields what `push` returns for each keyframe, in order, in lists of those whose frames are made at once.

        The frames of a list lie in memory from one call of `allocate`. `further_of` has the samples between them.
        `report` is, but for what it counts of these, that of the list before, so that the host does not wait for a GPU;
        `end` makes it that of the last list.

        Args:
            keyframes: in the order of time.
            margin, allocate: as of `push`.
        """
        self._fit((1, *keyframes[0].image.shape[1:3]), margin)
        images = self._image(joined([one.image for one in keyframes]))
        start = 0
        for end, one in enumerate(keyframes, 1):
            if self.gaps == 1 or self._last is None or np.any(one.episodes != self._episodes):
                made = self.push(one.stamp_ns, one.episodes, one.image, None, None, margin, allocate, one.states)
                self.further_of = [self.further]
                yield [made]
            elif end == len(keyframes) or end - start == self.gaps or np.any(keyframes[end].episodes != one.episodes):
                yield self._between(keyframes[start:end], images[start:end], margin, allocate)
            else:
                continue
            start = end

    def end(self) -> None:
        """Makes `report` that of the gaps made last."""
        self.report = Report() if self._rigid is None else self._rigid[1].last_report()

    def _between(
        self, keyframes: Sequence[Arrived], images: wp.array, margin: int, allocate: Allocate
    ) -> list[tuple[np.ndarray, Any]]:
        """Makes the gaps that end with these keyframes of one episode.

        Fewer than `gaps` are preceded by gaps of length 0, whose frames nobody gets.
        """
        last = self._last
        assert last is not None and last.states is not None
        stamps = [self._stamp, *(one.stamp_ns for one in keyframes)]
        for before, after in pairwise(stamps):
            if after <= before:
                raise ValueError(f"keyframe at {after} ns came after the one at {before} ns of the same episode")
        spare = self.gaps - len(keyframes)
        states = [last.states] * (spare + 1)
        for one in keyframes:
            checked = self._check(one.states)
            assert checked is not None
            states.append(checked)
        times = np.array([self._stamp] * spare + stamps)
        a = KeyframeView(last.image, states=StatesInARow(states[:-1]), stamp_ns=stamps[0], own=times[:-1])
        if self._row is not None and self._row[1] is last:
            a.after = self._row[0]
        else:
            a.image = joined([*[last.image] * (spare + 1), *([images[:-1]] if len(keyframes) > 1 else [])])
        b = KeyframeView(joined([*[last.image] * spare, images]), states=StatesInARow(states[1:]))
        b.stamp_ns, b.own = stamps[-1], times[1:]
        out = allocate((self.gaps, *self._frames_shape(self.upsampling, self._samples)[1:]))
        fine = (self.gaps, *self._frames_shape(self.upsampling, 1)[1:])
        made = out if self._samples == 1 else self._fine(fine, isinstance(out, wp.array))
        method = self._method_in_a_row()
        self.report = method.between(a, b, np.arange(self.gaps) < spare, made)
        further = method.further if isinstance(method, Refined) else None
        self.further_of = [None] * len(keyframes) if further is None else further.of_each(self.gaps)[spare:]
        if self._samples > 1:
            self._average(made, out)
        self._last = KeyframeView(images[-1:], states=states[-1], stamp_ns=stamps[-1])
        self._stamp, self._episodes = stamps[-1], np.array(keyframes[-1].episodes)
        self._row = b, self._last
        return [
            (subframe_stamps(before, after, self.upsampling), out[spare + n : spare + n + 1])
            for n, (before, after) in enumerate(pairwise(stamps))
        ]

    def begin(self, envs: int, height: int, width: int, margin: int = 0) -> None:
        """Does what `Interpolator.begin` does, for several gaps at once."""
        self._size, self._samples = ((envs, height, width), margin), self._samples_of(height, width, margin)
        self._method_in_a_row()

    def warm_up_for(self, envs: int, height: int, width: int, margin: int = 0, gap_ns: int = 0) -> None:
        """Does what `Interpolator.warm_up_for` does, for several gaps at once."""
        self.begin(envs, height, width, margin)
        self._warmed, gap_ns = True, made_up.length(gap_ns, self._device)
        if self._method_in_a_row().remembers:
            self.gaps, self._rigid = 1, None
        if self.gaps == 1 or self.upsampling > made_up.LONGEST or self._scene is None or self._camera is None:
            super().warm_up_for(envs, height, width, margin, gap_ns)
            return
        self._image(np.ones((1, 2, 2, 3), np.float16))
        image, episodes = made_up.images(envs, height, width)[0], np.full(envs, -1, np.int32)
        runs = 1 if self._device.is_cpu else made_up.RECORDED
        # Paths of many bodies are looked up for three keyframes only: for all it would take longer than all else.
        swayed = [made_up.states(self._scene, self._camera, envs, k * gap_ns, gap_ns) for k in range(3)]
        stamps = list(made_up.stamps(runs * self.gaps, gap_ns))
        states = [swayed[0], *(swayed[1 + k % 2].at(stamps[k : k + 2]) for k in range(len(stamps) - 1))]
        arrived = [Arrived(stamp, episodes, image, then) for stamp, then in zip(stamps, states)]
        for _ in self.push_all(arrived, margin, self._scratch):
            pass
        self.end()
        self._warmed = True

    def _method_in_a_row(self) -> Rigid | Refined:
        """Gives the method that makes several gaps, built at the first call."""
        if self._rigid is None or self._rigid[0] != self._size:
            assert self._size is not None
            (_, height, width), margin = self._size
            made = self._build(self.gaps, height, width, margin, in_a_row=True)
            assert isinstance(made, Rigid | Refined)
            self._rigid = self._size, made
        return self._rigid[1]
