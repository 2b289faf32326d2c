"""Cost and error of every way to run a scene, from a few windows of its motion, before a run starts.

The error is that of the events against dense rendering at a high rate, in a cut-out of the camera's image where there
is change: a smaller camera with its principal point moved, so that pixels move as they do in the whole image. The
windows are the environments of one rendering. Frames at lower rates and smaller K are among those of the highest, so
that each method runs once per keyframe rate; beyond 1000 frames per second it runs only where more frames still help
and dense rendering is not as good at the same cost, the other candidates being left out. The cost is measured at the
full size: keyframes with what each method reads of them, a gap of each method, the sensor's frames; how it grows with
the length of a gap is taken from the cut-out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.probe_cost import MIDDLE_RATE, FullSize
from bench.probe_error import Windows
from bench.probe_setting import Grid, Setting, Way
from bench.world import World
from evis.clock import NS
from nodes.interpolator.choice import BASE_RATE, Candidate, with_steps_between

DEAR_S = 0.02
"""Cost of a keyframe from which on the reference has half the rate [s]."""
WINDOWS = 2
MOST = 0.42
"""Share of a method's error that must be dense rendering's for more frames to help."""
Say = Callable[[str], None]


def probe(setting: Setting, say: Say = lambda line: None) -> list[Candidate]:
    """All candidates with their cost and error. say: told what is being done, for a terminal."""
    length = Grid.of(setting).length
    end = max(setting.duration_ns, length)
    say("moving the scene")
    started = setting.clock()
    world = World(setting.scene, end, setting.seed)
    moving = (setting.clock() - started) / (end / NS) if setting.scene.dynamic else 0.0
    say("costs at full size")
    starts = starts_of(setting, end - length)
    full = FullSize(setting, world, starts, length)
    costs = full.measure() | {"moving": moving}
    dear = costs["key none"] > DEAR_S
    grid = Grid.of(setting, dear)
    say("dense frames")
    windows = Windows(setting, world, grid, starts, full.cut())
    low = [way for way in grid.ways if way[0] == "none" or way[1] * way[2] <= 1.5 * BASE_RATE]
    found: list[Candidate] = []
    for ways in (low, sorted(set(grid.ways) - set(low))):
        ways = [way for way in ways if way in low or _worth(way, found)]
        for line in windows.compare(ways):
            say(line)
        found += [_candidate(setting, way, windows, costs) for way in ways]
    return found if setting.upsampling else with_steps_between(found)


def starts_of(setting: Setting, last: int) -> list[int]:
    """Where windows begin, evenly from 0 to `last` [ns]: at sub-steps, for an impact lies between two of them."""
    step = setting.scene.timestep_ns
    return sorted({round(t) // step * step for t in np.linspace(0, last, WINDOWS)})


def _candidate(setting: Setting, way: Way, windows: Windows, costs: dict[str, float]) -> Candidate:
    """What was found about one way."""
    method, rate, k = way
    frames = rate * k
    seconds = (frames if method == "none" else rate) * costs["key " + method] + frames * costs["sense"]
    seconds += costs["events"]
    if method != "none":
        # A sub-frame at this keyframe rate, by what one costs at the rate that was measured at full size.
        per = {r: seconds for (m, r), seconds in windows.spent.items() if m == method}
        middle = min(per, key=lambda r: abs(r - MIDDLE_RATE))
        seconds += frames * costs["frame " + method] * per[rate] / per[middle]
    seconds = costs["moving"] + seconds * setting.envs
    return Candidate(method, rate, k, round(windows.error[way], 6), round(float(seconds), 6))


def _worth(way: Way, found: list[Candidate]) -> bool:
    """Whether a method at a keyframe rate may gain from more frames: a good part of its error until now is that of
    dense rendering of as many frames, and dense rendering at the same cost is worse."""
    method, rate, _ = way
    last = max((c for c in found if (c.method, c.keyframe_rate) == (method, rate)), key=lambda c: c.upsampling)
    dense = sorted((c for c in found if c.method == "none"), key=lambda c: c.seconds)
    same = [c.error for c in dense if abs(c.frame_rate / last.frame_rate - 1) < 0.01]
    if same and same[0] < MOST * last.error:
        return False
    cost, error = (np.log([max(v, 1e-9) for v in values]) for values in zip(*((c.seconds, c.error) for c in dense)))
    return last.seconds < dense[0].seconds or last.error < np.exp(np.interp(np.log(last.seconds), cost, error))
