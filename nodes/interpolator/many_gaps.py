"""Makes the frames of several gaps between keyframes at once, where nobody waits for each gap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from evis.gpu.in_a_row import joined, parted
from evis.runtime.clock import subframe_stamps
from nodes.interpolator import warm_up as made_up
from nodes.interpolator.interpolator import Image, Interpolator
from nodes.interpolator.keyframe import KeyframeView, Report, Span, States, StatesInARow, check_follows
from nodes.interpolator.pixel_means import Allocate, new_frames
from nodes.interpolator.rigid import Rigid
from nodes.interpolator.samples import Further, Parting

if TYPE_CHECKING:
    from nodes.interpolator.refine.method import Refined


@dataclass
class Arrived:
    """Holds a keyframe of one environment, with the arguments of `Interpolator.push`."""

    stamp_ns: int
    episodes: np.ndarray
    image: Image
    states: States | None


@dataclass(frozen=True)
class MadeGaps:
    """Holds the frames, further samples and counts of several gaps that were made at once.

    frames: for each, their times and themselves, as `Interpolator.push` returns them. further: samples of single pixels
    between those of each gap. report: counts, but for what it counts of these samples of the gaps made before, so that
    the host does not wait for a GPU.
    """

    frames: list[tuple[np.ndarray, Any]]
    further: list[Further | None]
    report: Report


@dataclass(frozen=True)
class _Row:
    """Holds gaps in a row: stamps [ns] of the keyframes at their ends and the states there, and what these are as
    environments, of which the first `spare` are of length 0."""

    stamps: list[int]
    states: list[States]
    spare: int
    gap: Span

    @classmethod
    def of(cls, stamp_ns: int, states: States, arrived: Sequence[tuple[int, States]], gaps: int) -> _Row:
        """Makes those that begin with a keyframe and end with those that arrived, `gaps` at most."""
        stamps, each = [stamp_ns, *(stamp for stamp, _ in arrived)], [states, *(one for _, one in arrived)]
        spare = gaps - len(arrived)
        times, all_of_them = np.array([stamp_ns] * spare + stamps), [states] * spare + each
        a, b = StatesInARow(all_of_them[:-1]), StatesInARow(all_of_them[1:])
        return cls(stamps, each, spare, Span(times[:-1], times[1:], a, b, np.arange(gaps) < spare, apart=True))

    def followed_by(self, arrived: Sequence[tuple[int, States]], gaps: int) -> _Row:
        """Makes those that come after these."""
        return _Row.of(self.stamps[-1], self.states[-1], arrived, gaps)

    def ends_with(self, first: States, arrived: Sequence[tuple[int, States]]) -> bool:
        """Tells whether these are the gaps from a keyframe with such states to those that arrived."""
        states = [first, *(one for _, one in arrived)]
        same = len(states) == len(self.states) and all(a is b for a, b in zip(states, self.states))
        return same and self.stamps[1:] == [stamp for stamp, _ in arrived]


class ManyGaps(Interpolator):
    """Makes the frames of up to `gaps` consecutive gaps at once, bit for bit as one by one.

    The gaps are given to the method as environments with times of their own. For method rigid and one environment.
    """

    def __init__(self, method: str, upsampling: int, gaps: int, **how: Any) -> None:
        """Makes an interpolator for several gaps at once. gaps: 2 or more. how: as of Interpolator."""
        super().__init__(method, upsampling, **how)
        self.gaps = gaps
        self._rigid: tuple[Any, Rigid | Refined] | None = None
        """The method for several gaps, and the image size ((E, H, W), margin) that it was made for."""
        self._row: tuple[KeyframeView, KeyframeView] | None = None
        """Views B of the gaps made last, and the last of these views by itself."""
        self._coming: _Row | None = None
        """The gaps that follow those that are being made, if they are known."""
        self._parting: Parting | None = None
        self._first = True
        """Whether the next gaps are the first ones: of these one is made by itself, which tells how many samples the
        others may have, for what lacks room on a GPU is done again."""

    def push_all(
        self,
        keyframes: Sequence[Arrived],
        deliver: Callable[[MadeGaps], None],
        margin: int = 0,
        allocate: Allocate = new_frames,
    ) -> None:
        """Delivers what `push` returns for each keyframe, in order, those at once whose frames are made at once.

        Their frames lie in memory from one call of `allocate`, of which the last one is always delivered before the
        next. On a GPU gaps that are followed by others are delivered while it works on these.

        Args:
            keyframes: in the order of time.
            deliver: takes what is made.
            margin, allocate: as of `push`.
        """
        self._fit((1, *keyframes[0].image.shape[1:3]), margin)
        images = self._image(joined([one.image for one in keyframes]))
        waiting: list[Callable[[], MadeGaps]] = []

        def hand_over() -> None:
            while waiting:
                deliver(waiting.pop(0)())

        runs = self._runs(keyframes)
        try:
            for (start, end, together), after in zip_longest(runs, runs[1:]):
                if not together:
                    hand_over()
                    one = keyframes[start]
                    made = self.push(one.stamp_ns, one.episodes, one.image, None, None, margin, allocate, one.states)
                    deliver(MadeGaps([made], [self.further], self.report))
                    continue
                row = self._row_of(keyframes[start:end])
                if after is not None and after[2]:
                    self._coming = row.followed_by(self._arrived(keyframes[after[0] : after[1]]), self.gaps)
                made_gaps = self._make_gaps(row, images[start:end], allocate, hand_over)
                self._episodes, self._first = np.array(keyframes[end - 1].episodes), False
                hand_over()
                waiting.append(made_gaps)
        finally:
            hand_over()

    def _runs(self, keyframes: Sequence[Arrived]) -> list[tuple[int, int, bool]]:
        """Splits keyframes into parts, from one to another, and tells of each whether its gaps are made at once."""
        runs: list[tuple[int, int, bool]] = []
        episodes, alone = self._episodes, self._last is None
        most = 1 if self._first and self._device.is_cuda and self._time_tolerance_ns > 0 else self.gaps
        for n, one in enumerate(keyframes):
            together = not alone and np.array_equal(one.episodes, episodes)
            if together and runs and runs[-1][2] and n - runs[-1][0] < most:
                runs[-1] = runs[-1][0], n + 1, True
            else:
                if runs and runs[-1][2]:
                    most = self.gaps
                runs.append((n, n + 1, together))
            episodes, alone = one.episodes, False
        return runs

    def last_report(self) -> Report:
        """Gives the report of the gaps made last, once."""
        return Report() if self._rigid is None else self._rigid[1].last_report()

    def _arrived(self, keyframes: Sequence[Arrived]) -> list[tuple[int, States]]:
        """Gives stamps and states of keyframes."""
        found = []
        for one in keyframes:
            states = self._check(one.states)
            assert states is not None
            found.append((one.stamp_ns, states))
        return found

    def _row_of(self, keyframes: Sequence[Arrived]) -> _Row:
        """Gives the gaps that end with these keyframes: those that were expected, or others."""
        last, arrived = self._last, self._arrived(keyframes)
        assert last is not None and last.states is not None
        expected, self._coming = self._coming, None
        if expected is not None and expected.ends_with(last.states, arrived):
            return expected
        return _Row.of(self._stamp, last.states, arrived, self.gaps)

    def _make_gaps(
        self, row: _Row, images: wp.array, allocate: Allocate, before_that: Callable[[], None]
    ) -> Callable[[], MadeGaps]:
        """Makes gaps of one episode, which end with these images; before_that: is called before `allocate`.

        What it returns waits until their samples are counted, and gives them.

        Fewer than `gaps` are preceded by gaps of length 0, whose frames nobody gets.
        """
        last, spare, gap = self._last, row.spare, row.gap
        assert last is not None
        for before, after in pairwise(row.stamps):
            check_follows(before, after)
        a = KeyframeView(last.image, states=gap.a, stamp_ns=row.stamps[0], own=gap.starts)
        if self._row is not None and self._row[1] is last:
            a.after = self._row[0]
        else:
            a.image = joined([*[last.image] * (spare + 1), *([images[:-1]] if len(images) > 1 else [])])
        b = KeyframeView(joined([*[last.image] * spare, images]), states=gap.b, stamp_ns=row.stamps[-1], own=gap.ends)
        means, shape = self._means, self._means.shape(self.gaps, self.upsampling)
        method, further = self._warmed_method(), None
        if not isinstance(method, Rigid) and self._device.is_cuda:
            method.following = None if self._coming is None else self._coming.gap
            method.meanwhile = before_that
            made = None if means.samples == 1 else means.fine(self.gaps, self.upsampling, on_device=True)
            report, further = method.between(a, b, gap.held, made), method.further
            before_that()
            out = allocate(shape)
            if made is None:
                method.hand_over(out)
        else:
            before_that()
            out = allocate(shape)
            made = means.target(out)
            report = method.between(a, b, gap.held, made)
            if not isinstance(method, Rigid):
                further = method.further
        means.average(made, out)
        each: Callable[[], list[Further | None]] = lambda: [None] * self.gaps
        if further is not None:
            if self._parting is None:
                self._parting = Parting(self.gaps, self._device)
            each = self._parting.of(further)
        self._last = KeyframeView(images[-1:], states=row.states[-1], stamp_ns=row.stamps[-1])
        self._stamp = row.stamps[-1]
        self._row = b, self._last
        stamps = [subframe_stamps(before, after, self.upsampling) for before, after in pairwise(row.stamps)]
        frames = list(zip(stamps, parted(out, range(1, self.gaps + 1))[spare:]))
        return lambda: MadeGaps(frames, each()[spare:], report)

    def warm_up_for(self, envs: int, height: int, width: int, margin: int = 0, gap_ns: int = 0) -> None:
        """Builds and compiles what `Interpolator.warm_up_for` does, for several gaps at once."""
        super().warm_up_for(envs, height, width, margin, gap_ns)
        self._first = True

    def _push_made_up(
        self, stamp_ns: int, episodes: np.ndarray, images: made_up.Images, states: States | None, margin: int
    ) -> None:
        # Of each call one gap is made: what the others need is the same.
        self.push_all([Arrived(stamp_ns, episodes, images[0], states)], lambda made: None, margin, self._scratch)

    def _warmed_method(self) -> Rigid | Refined:
        """Gives the method that makes several gaps, built at the first call."""
        if self._rigid is None or self._rigid[0] != self._size:
            assert self._size is not None
            (_, height, width), margin = self._size
            made = self._build(self.gaps, height, width, margin, in_a_row=True)
            self._rigid = self._size, cast("Rigid | Refined", made)
        return self._rigid[1]
