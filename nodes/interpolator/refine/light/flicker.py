"""Chooses the instants of a gap at which flickering light is evaluated: between them its logarithm is a line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.runtime.clock import NS
from evis.scene.model import Waveform
from evis.scene.sampling import FOLLOWED
from nodes.interpolator.refine.light.flicker_kernels import Marks
from nodes.interpolator.refine.samples.lists import SPARE
from nodes.interpolator.refine.samples.request_kernels import PARTS, SHARP
from nodes.renderer.lights.lights import waveform_phase, waveform_strengths

ROUNDED = 1e-6
"""Part by which gaps of one rate may differ, for their ends are rounded to nanoseconds."""
LEAST_STRENGTH = 0.01
"""Of a light, relative to its mean, below which its logarithm does not matter: something else is about as bright."""
OF_SEVERAL = 0.25
"""Part of the distance from a straight line up to which the logarithm of a strength counts as on it, where several
flicker."""
PER_PERIOD = 32
"""Instants of a period of a sine that there are, of which those are taken that it takes."""
PER_SWITCH = 32
"""Instants that there are for each switch of a square wave, where there are others: what shows between two switches is
looked at only if there is an instant between them. Lamps of four such waveforms (214 to 298 Hz) lose 0.2 % of their
events with 32, 11 % with 4."""


class Flicker:
    """Finds the marks of one gap after another, for the waveforms of a scene's lights.

    kernel: the struct of what was found last, in arrays that stay while there is room, for recorded launches.
    """

    def __init__(
        self, waveforms: Iterable[Waveform | None], bend: float, device: Any, added: Sequence[Waveform] = ()
    ) -> None:
        """Takes the waveforms of a scene's lights. bend: how far ln of a strength may be off a straight line. added:
        the waveforms whose lights' radiance is added up, see `log_type`."""
        given = {w for w in waveforms if w is not None}
        self._any = bool(given)
        self._added = added
        self._waveforms = sorted({w for w in given if w.depth > 0 and w.frequency > 0}, key=repr)
        # Where one lamp makes up for another their sum is straighter than either, and is to be known as well.
        self._bend, self._device = (bend if len(self._waveforms) < 2 else OF_SEVERAL * bend), device
        self.kernel: Any = Marks()
        self.kernel.first = wp.zeros((1, 1), dtype=wp.int32, device=device)
        self.kernel.at, self.kernel.later = (wp.empty(0, dtype=wp.int32, device=device) for _ in range(2))
        self.kernel.at_start = wp.empty(0, dtype=wp.float32, device=device)

    def instants(self, gap_ns: int) -> int:
        """Gives how many instants a gap has to have at least, so that no period is missed."""
        slow, gap = self._slow(gap_ns), gap_ns * 1e-9
        least = max((_least_above(_per_period(w) * gap * w.frequency) for w in slow), default=1)
        switches = sum(2.0 * gap * w.frequency for w in slow if w.kind == "square")
        return max(least, _least_above(PER_SWITCH * switches)) if len(slow) > 1 else least

    def follows(self, gap_ns: int) -> bool:
        """Tells whether all of them are slow enough to be followed."""
        return len(self._slow(gap_ns)) == len(self._waveforms)

    def find(self, starts: np.ndarray, stamps: np.ndarray, coarse: int) -> None:
        """Finds the marks of a gap.

        starts: of the gap, int64 [E] ns. stamps: of its instants, int64 [n] or, of environments apart, [E, n] ns.
        coarse: intervals of which each has as many of them, the last at its end.
        """
        if self._added:
            begun = waveform_strengths(self._added, starts).astype(np.float32).reshape(-1)
            if self.kernel.at_start.size != begun.size:
                self.kernel.at_start = wp.empty(begun.size, dtype=wp.float32, device=self._device)
            self.kernel.at_start.assign(begun)
        if not self._any:
            return
        # What flickers by nothing has no marks, but kernels ask for them.
        rows = stamps[None] if stamps.ndim == 1 else stamps
        each = rows.shape[1] // coarse
        firsts = np.zeros((len(rows), coarse + 1), np.int32)
        at: list[int] = []
        later: list[int] = []
        known: dict[bytes, list[dict[int, int]]] = {}
        for row, (start, instants) in enumerate(zip(starts, rows)):
            t = np.concatenate([[start], instants])
            if t.tobytes() not in known:
                known[t.tobytes()] = self._of(t, coarse, each)
            for k, marks in enumerate(known[t.tobytes()]):
                firsts[row, k] = len(at)
                at += sorted(marks)
                later += [marks[i] for i in sorted(marks)]
            firsts[row, coarse] = len(at)
        kernel = self.kernel
        if kernel.first.shape != firsts.shape:
            kernel.first = wp.empty(firsts.shape, dtype=wp.int32, device=self._device)
        kernel.first.assign(firsts)
        for name, values in (("at", at), ("later", later)):
            if getattr(kernel, name).size < len(values):
                setattr(kernel, name, wp.empty(int(SPARE * len(values)), dtype=wp.int32, device=self._device))
            if values:
                getattr(kernel, name)[: len(values)].assign(np.array(values, np.int32))

    def _slow(self, gap_ns: int) -> list[Waveform]:
        return [w for w in self._waveforms if w.frequency * gap_ns * 1e-9 <= FOLLOWED * (1 + ROUNDED)]

    def _of(self, t: np.ndarray, coarse: int, each: int) -> list[dict[int, int]]:
        """Computes the marks within each coarse interval, and how much later they are, for instants t [n + 1]."""
        found: list[dict[int, int]] = [{} for _ in range(coarse)]
        for waveform in self._slow(int(t[-1] - t[0])):
            for k, marks in enumerate(found):
                mine = t[k * each : (k + 1) * each + 1]
                new = _switches(waveform, mine) if waveform.kind == "square" else _bends(waveform, mine, self._bend)
                for i, by in new.items():
                    marks[i] = _shared_delay(marks[i], by) if i in marks else by
        return found


def _shared_delay(one: int, other: int) -> int:
    """Computes how much later than its instant a mark is that two lights share, from what each asks for.

    What one light is sharp at is not to be moved by another; of two switches between the same instants, what is seen
    before is seen up to the first of them, and what is seen after from the last one on.
    """
    if one * other > 0:
        return min(one, other, key=abs)
    return other or one


def _least_above(count: float) -> int:
    """Rounds a count of a gap up to a greater whole number, the same one for all gaps of one rate."""
    return int(count * (1 - ROUNDED)) + 1


def _per_period(waveform: Waveform) -> float:
    """Counts the instants of a period, so that a square wave is seen before and after each switch."""
    if waveform.kind == "square":
        return 2.0 / min(waveform.duty, 1.0 - waveform.duty)
    return PER_PERIOD


def _switches(waveform: Waveform, t: np.ndarray) -> dict[int, int]:
    """Finds the marks before and after each switch of a square wave within instants t, whose ends are none."""
    strength = waveform_strengths([waveform], t)[:, 0]
    marks: dict[int, int] = {}
    for i in range(len(t) - 1):
        if strength[i] != strength[i + 1]:
            phase = waveform_phase(waveform, int(t[i]))
            ahead = (waveform.duty if phase < waveform.duty else 1.0) - phase
            part = int(ahead / waveform.frequency * NS / int(t[i + 1] - t[i]) * int(PARTS))
            part = min(max(part, int(SHARP)), int(PARTS) - int(SHARP))
            if i > 0:
                marks[i] = part - int(SHARP)
            if i + 1 < len(t) - 1:
                marks[i + 1] = part + int(SHARP) - int(PARTS)
    return marks


def _bends(waveform: Waveform, t: np.ndarray, bend: float) -> dict[int, int]:
    """Finds the marks of a smooth waveform within instants t, between which its logarithm is on a straight line.

    Where it turns there is one in any case: lines that pass below its highest value and above its lowest make the swing
    smaller, and a threshold that is just reached there would not be.
    """
    value = np.log(np.maximum(waveform_strengths([waveform], t)[:, 0], LEAST_STRENGTH))
    rises = np.diff(value)
    turns = {int(i) + 1 for i in np.flatnonzero(rises[:-1] * rises[1:] < 0.0)}
    marks: dict[int, int] = {}
    begun, low, high = 0, -np.inf, np.inf
    for i in range(1, len(t)):
        slope = (value[i] - value[begun]) / (i - begun)
        if not low <= slope <= high or i - 1 in turns:
            begun, low, high = i - 1, -np.inf, np.inf
            marks[begun] = 0
        over = 1.0 / (i - begun)
        low = max(low, (value[i] - bend - value[begun]) * over)
        high = min(high, (value[i] + bend - value[begun]) * over)
    return marks
