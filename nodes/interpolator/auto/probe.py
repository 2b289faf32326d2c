"""Measures cost and error of every way to run a scene, from a few windows of its motion, before a run starts.

The error is that of the events against dense rendering at a high rate, in cut-outs of the camera's image where there is
change, each at another time: a smaller camera with its principal point moved, so that pixels move as they do in the
whole image. Frames at smaller K are among those of the largest, so that each method runs once or twice per keyframe
rate. The cost is measured at the full size: keyframes with what each method reads of them, whole gaps of each method at
the keyframe rates that it is compared at, the sensor's frames. Where it decides, `trial` looks again.

What costs no less than something else and cannot be much better is left out before its error is looked at: of the same
frames no method is better than dense rendering, nor is it at longer gaps better than at shorter ones. All else is
looked at as long as there is time, the most promising first. Where there is no time for a reference that is fine enough
for 2000 frames per second, their errors follow from those of 1000.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from evis.runtime.clock import NS
from nodes.interpolator.auto.choice import BASE_RATE, EVEN, Candidate, with_steps_between
from nodes.interpolator.auto.cost import FullSize
from nodes.interpolator.auto.error import MARGIN, Windows
from nodes.interpolator.auto.overlap import Overlapped
from nodes.interpolator.auto.setting import REFERENCE_HZ, Grid, Setting, Way
from nodes.interpolator.auto.trial import Measured
from nodes.interpolator.auto.world import World

WINDOWS = 2
CUTS = ((80, 60), (40, 30))
"""Sizes of the cut-out: the first unless its pixels are dear [px]."""
ALLOWED_S = 2.5
"""Time for all but a method's first look, which is taken whatever it takes: kernels may have to be compiled [s]."""
GAIN = 1.1
"""Error over that of something as cheap, from which on a way is looked at."""
KEPT = 0.8
"""Share of what a method's error is above dense rendering that it has at more frames or shorter gaps, at least."""
ORDER = (
    ("rigid", 62.5), ("splat", 125.0), ("splat", 31.25), ("rigid", 31.25), ("splat", 62.5), ("splat", 250.0),
    ("rigid", 125.0), ("rigid", 250.0),
)  # fmt: skip
"""Methods and keyframe rates [Hz], the most promising first; others, which users give, come as they are."""
MORE = 1.5
"""Ratio of frames per second from which on they are more than others: between those of two powers of two."""
FIRST = {"splat": BASE_RATE, "rigid": 2 * BASE_RATE}
"""Frames per second, about, up to which a method is looked at before more are: they rarely help splat."""
Say = Callable[[str], None]
"""Is called with a line about what is being measured, for a terminal."""


def probe(setting: Setting, say: Say = lambda line: None) -> Measured:
    """Finds all candidates with their cost and error, before any trial. say: called with what is being done."""
    length = Grid.of(setting).length
    end = max(setting.duration_ns, length)
    say("moving the scene")
    started = setting.clock()
    world = World(setting.scene, end, setting.seed)
    moving = (setting.clock() - started) / (end / NS) * setting.envs if setting.scene.dynamic else 0.0
    starts = starts_of(setting, end - length)
    say("costs at full size")
    full = (Overlapped if setting.on_gpu else FullSize)(setting, world, starts)
    full.measure_keyframes()
    windows, grid = _reference(setting, world, starts, full, say)
    search = Search(setting, grid, full, windows, moving, say)
    search.run()
    if not setting.upsampling:
        search.extrapolate()
    found = [c for c in search.found if c.method in setting.methods]
    return Measured(found if setting.upsampling else with_steps_between(found), moving)


def starts_of(setting: Setting, last: int) -> list[int]:
    """Gives the start times of the windows [ns], evenly from 0 to `last`, at sub-steps: an impact lies between two."""
    step = setting.scene.timestep_ns
    return sorted({round(t) // step * step for t in np.linspace(0, last, WINDOWS)})


def _reference(setting: Setting, world: World, starts: list[int], full: FullSize, say: Say) -> tuple[Windows, Grid]:
    """Renders the reference in all windows, as finely as there is time for."""
    grids = {Grid.of(setting, hz): allowed for hz, allowed in REFERENCE_HZ.items()}
    least, allowed = list(grids.items())[-1]
    pixel_s = full.keyframe["none"] / (setting.camera.width * setting.camera.height)
    for size in CUTS:
        cuts = full.cuts(size, WINDOWS)
        pixels = sum((width + 2 * MARGIN) * (height + 2 * MARGIN) for _, _, width, height in cuts)
        if pixel_s * pixels * least.gap <= allowed:
            break
    windows = Windows(setting, world, [starts[n % len(starts)] for n in range(WINDOWS)], cuts)
    per_step = windows.seconds_per_step()
    grid = next((grid for grid, allowed in grids.items() if grid.gap * per_step <= allowed), least)
    say(f"dense frames at {grid.base:g} Hz")
    windows.draw(grid)
    return windows, grid


class Search:
    """Finds candidates, one method and keyframe rate after another."""

    def __init__(self, setting: Setting, grid: Grid, full: FullSize, windows: Windows, moving: float, say: Say) -> None:
        """Takes what is searched, and by which measurements. moving: the physics engine's seconds per simulated second,
        of all environments."""
        self._setting, self._grid, self._full, self._windows, self._say = setting, grid, full, windows, say
        self._moving = moving
        self._looked_at: dict[tuple[str, float], float] = {}
        """Error above dense rendering, by method and keyframe rate."""
        self.found: list[Candidate] = []

    def run(self) -> None:
        """Measures the candidates, the most promising first, and puts them into `found`."""
        dense = [way for way in self._grid.ways if way[0] == "none"]
        self._say("errors of dense rendering")
        self._add(dense)
        pairs = list(dict.fromkeys((m, r) for m, r, _ in self._grid.ways if m != "none"))
        pairs.sort(key=lambda pair: ORDER.index(pair) if pair in ORDER else 0)
        left = ALLOWED_S
        for high in (False, True):
            for method, rate in pairs:
                first = all(m != method for m, _ in self._looked_at)
                if not first and left <= 0:
                    continue
                own = [way for way in self._grid.ways if way[:2] == (method, rate)]
                began = self._setting.clock()
                self._look_at([way for way in own if (way[1] * way[2] > MORE * FIRST.get(method, BASE_RATE)) == high])
                left -= 0.0 if first else self._setting.clock() - began

    def extrapolate(self) -> None:
        """Adds what has twice the most frames per second that the reference allows, where these are few.

        The error of dense rendering goes on falling as it did last, that of a warp stays above it by as much.
        """
        dense = sorted((c.frame_rate, c.error) for c in self.found if c.method == "none")
        if len(dense) < 2 or dense[-1][0] > MORE * BASE_RATE:
            return
        (_, before), (top, last) = dense[-2:]
        falls_to = float(np.clip(last / max(before, 1e-9), 0.25, 1))
        for c in [c for c in self.found if c.frame_rate > top / np.sqrt(2)]:
            now = self._dense(c.frame_rate)
            more = c.upsampling == 1
            way = (c.method, c.keyframe_rate * (1 + more), c.upsampling * (2 - more))
            seconds = self._seconds(way)
            assert seconds is not None
            error = now * falls_to + max(c.error - now, 0.0)
            self.found.append(Candidate(*way, round(error, 6), round(seconds, 6)))

    def _look_at(self, own: list[Way]) -> None:
        """Measures cost and error of ways of one method and keyframe rate, of those that could be chosen."""
        useful = [way for way in own if self._useful(way)]
        if not useful:
            return
        method, rate, _ = useful[0]
        if (method, rate) not in self._full.gaps:
            self._say(f"cost of {method} at {rate:g} keyframes per second")
            self._full.measure_gap(method, rate)
            useful = [way for way in own if self._useful(way)]
        if useful:
            self._say(f"errors of {method} at {rate:g} keyframes per second")
            self._add(useful)

    def _add(self, ways: list[Way]) -> None:
        errors = self._windows.errors(ways)
        for way, error in zip(ways, errors, strict=True):
            seconds = self._seconds(way)
            assert seconds is not None
            self.found.append(Candidate(*way, round(error, 6), round(seconds, 6)))
        method, rate, _ = ways[0]
        if method != "none":
            above = [error - self._dense(r * k) for (_, r, k), error in zip(ways, errors)]
            self._looked_at[method, rate] = min(above)

    def _seconds(self, way: Way) -> float | None:
        """Predicts the run time of a way [s per simulated s], physics included."""
        seconds = self._full.seconds(way)
        return None if seconds is None else self._moving + seconds * self._setting.envs

    def _dense(self, frame_rate: float) -> float:
        """Interpolates the error of dense rendering, as a power of the rate between the measured ones."""
        dense = sorted((c.frame_rate, c.error) for c in self.found if c.method == "none")
        rates, errors = (np.log([max(v, 1e-9) for v in values]) for values in zip(*dense))
        return float(np.exp(np.interp(np.log(frame_rate), rates, errors)))

    def _useful(self, way: Way) -> bool:
        """Tells whether the error of a way may be well below that of everything found so far that costs no more."""
        method, rate, k = way
        seconds = self._seconds(way)
        if seconds is None:
            return True
        above = [excess for (m, r), excess in self._looked_at.items() if m == method and r >= rate]
        least = self._dense(rate * k) + KEPT * max(above, default=0.0)
        rivals = [c for c in self.found if c.method in self._setting.methods]
        return all(c.error > GAIN * least for c in rivals if c.seconds <= EVEN * seconds)
