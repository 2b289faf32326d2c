"""Implements method `rigid` with further samples of single pixels between its frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from evis.gpu.building import begin_building, build_together
from nodes.interpolator.keyframe import KeyframeView, Report, Span
from nodes.interpolator.refine.refinement import Refinement
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.samples import Further

SLOPE = 67.0
"""Error of ln I [1/s] that is worth an error of time, 0.02 for 0.3 ms: twice of that makes errors of eight scenes
larger by up to a fifth, and of painted walls by a third, for 3 to 10 % less time."""
LEAST, MOST = 0.0125, 0.1
"""Errors of ln I that are looked for at least and at most; frames alone, which err by more in time, bear 0.1."""


def tolerance_of(time_tolerance_s: float) -> float:
    """Gives the error of ln I that goes with an error of time, unless another one is given."""
    return min(max(SLOPE * time_tolerance_s, LEAST), MOST)


class Refined:
    """Makes the frames of `Rigid`, and samples of single pixels between them where what they show changes.

    sampled: whether there are such samples; without, the frames are the same bytes. further: the samples of the gap
    made last, None without any. following: the gap after the one that is made next, where it is known, to be prepared
    while a GPU works on that. meanwhile: what else is done then.
    """

    def __init__(
        self, rigid: Rigid, tolerance_ns: float, threads: int = 1, light_samples: int = 16, fineness: int = 1
    ) -> None:
        """Takes what makes the frames. tolerance_ns: greatest error wanted in the time of a threshold crossing [ns].
        fineness: the pixels of `rigid` are sub-pixels, of which so many per axis make a pixel; `further` is then of
        their means."""
        self.rigid, self.refinement = rigid, Refinement(rigid, tolerance_ns, threads, light_samples, fineness)
        rigid.looks_at = self.refinement.stamps
        self.sampled = True
        self.further: Further | None = None
        self.following: Span | None = None
        self.meanwhile: Callable[[], None] | None = None
        self._built = False

    def begin_build(self) -> None:
        """Has its kernels compiled, while the caller does something else, for the first gap."""
        begin_building(self.rigid.visibility.device, self._own_kernels())

    def _own_kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Lists the kernels that it launches besides those of `rigid`."""
        return self.refinement.kernels() if self.sampled else []

    def prepare_for(self, gap_ns: int) -> None:
        """Divides gaps that are shorter than `gap_ns` [ns] as finely as one of that length; 0 = as they are."""
        self.refinement.as_long_as_ns = gap_ns

    def hand_over(self, out: np.ndarray | wp.array) -> None:
        """Implements `Rigid.hand_over`."""
        self.rigid.hand_over(out)

    def last_report(self) -> Report:
        """Implements `Rigid.last_report`, without what samples count, which `between` has returned."""
        return self.rigid.last_report()

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array | None
    ) -> Report:
        """Implements `Method.between`. out: None on a GPU where `hand_over` is to write the frames later."""
        if not self._built:
            build_together(self.rigid.visibility.device, [*self.rigid.kernels(), *self._own_kernels()])
            self._built = True
        held = np.asarray(held, bool)
        told = self.rigid.begin(a, b, held, out)
        following, self.following = self.following, None
        if self.rigid.rested or not self.sampled:
            self.further = None
            return told()
        meanwhile = self.meanwhile or (lambda: None)
        self.further = self.refinement.further(a, b, held, self.rigid.frames, following, meanwhile)
        report, refinement = told(), self.refinement
        report.refined, report.reshaded = refinement.evaluated, report.reshaded + refinement.shaded
        report.unreached = 0 if refinement.reached else int((~held).sum())
        report.unseen = int(refinement.unseen.sum())
        return report
