"""Estimates a scene from a recording: a wheel, half black and half white, that turns about a hub before the camera.

The border of black and white is a line through the hub, and stays one however the wheel is tilted, so the scene is a
hub, the angle psi(t) at which the border lies in the image, which half is white, and the blur of the border. ON events
begin where white arrives, at psi, OFF events half a turn on. So the angle about the hub at which bursts begin, plus pi
for OFF, gathers at psi(t): the hub is the point about which it gathers best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.events.measure.bursts import Bursts, bursts_of

WINDOW_NS = 4_000_000
"""One angle is found for each; at 60 rad/s the border turns by 14 degrees in it."""
LEAST_EVENTS, LEAST_BURSTS = 1000, 200
"""Events and bursts that a recording needs: about those of 2 SMOOTH windows of LEAST_BEGINNINGS, five events each."""
BUSY, BUSIEST = 0.04, 95
"""Share of the bursts in a busy window, that of this percentile, from which on a window belongs to a motion."""
PAUSE = 5
"""Windows without that, after which a motion is another one."""
LEAST_BEGINNINGS = 12
"""Beginnings of bursts that a window needs for an angle."""
LEAST_RESULTANT = 0.5
"""Mean resultant length of these beginnings (1: all at one angle) that it needs."""
LEAST_GATHERED = 0.75
"""Mean resultant length (1: all beginnings at one angle) below which this is no such wheel."""
NEAREST_PX = 8.0
"""Closer to the hub than this an angle says little."""
LEAST_TURNS = 0.25
"""Turns of the border that are needed: with fewer, hub and angle could make up for each other."""
FIRST_STEPS, FINER, HUB_PX = 10, 2.5, 0.05
"""Steps of the first grid for the hub over the box, how much finer the next ones are, and the finest step."""
SMOOTH = 7
"""Windows of the parabola that smooths the angle."""


class NoWheel(ValueError):
    """Says that the recording does not show a turning wheel, half black and half white."""


@dataclass(frozen=True)
class Wheel:
    """Describes the wheel that was found.

    hub: (x, y) [px]. at int64 [K, ns], angle float64 [K, rad]: the border's angle, unwrapped. turning: +1 or -1, its
    sense (x towards y). gathered: how well beginnings of bursts agree with it, 0 to 1. mask: bool [H, W], pixels of the
    part `box` (x, y, width, height) of the sensor over which the border passed; box: where the recording has events.
    """

    hub: tuple[float, float]
    at: np.ndarray
    angle: np.ndarray
    turning: int
    gathered: float
    mask: np.ndarray
    box: tuple[int, int, int, int]

    @property
    def start_ns(self) -> int:
        """Returns the time at which the motion begins [ns]."""
        return int(self.at[0])

    @property
    def end_ns(self) -> int:
        """Returns the time at which the motion ends [ns]."""
        return int(self.at[-1])

    @property
    def turns(self) -> float:
        """Counts the turns of the wheel between start and end of the motion."""
        return float(abs(self.angle[-1] - self.angle[0]) / (2 * np.pi))

    @property
    def speed(self) -> np.ndarray:
        """Returns the angular speed [K, rad/s]."""
        return np.asarray(np.abs(np.gradient(self.angle, self.at * 1e-9)))

    def beyond(self, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Computes the distance float32 [K, N, px] from the border into the white at times t [K, ns] and pixels x, y
        [N]."""
        psi = np.interp(t, self.at, self.angle)[:, None]
        dx, dy = x[None] - self.hub[0], y[None] - self.hub[1]
        return np.asarray(self.turning * (np.sin(psi) * dx - np.cos(psi) * dy), dtype=np.float32)


def find_wheel(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> Wheel:
    """Estimates the scene of a recording: t int64 [n, ns] ascending, x, y [n, px], p [n], 1 = ON. Raises NoWheel."""
    if len(t) < LEAST_EVENTS:
        raise NoWheel(f"{len(t)} events are too few for a turning wheel")
    box = (int(x.min()), int(y.min()), int(np.ptp(x)) + 1, int(np.ptp(y)) + 1)
    column, row = x.astype(np.int64) - box[0], y.astype(np.int64) - box[1]
    found = bursts_of(t, row * box[2] + column, p)
    start, end = _motion(found)
    inside = (found.start >= start) & (found.start <= end)
    bx, by = (found.pixel % box[2] + box[0])[inside], (found.pixel // box[2] + box[1])[inside]
    window = (found.start[inside] - start) // WINDOW_NS
    shift = np.pi * (found.p[inside] == 0)
    hub = _hub(bx, by, window, shift, box)
    gathered, middle, resultant, counts = _angles(bx, by, window, shift, hub)
    good = (counts >= LEAST_BEGINNINGS) & (resultant > LEAST_RESULTANT)
    if gathered < LEAST_GATHERED or good.sum() < 2 * SMOOTH:
        raise NoWheel(
            f"bursts begin at no common angle about any point (they agree to {gathered:.2f}, {LEAST_GATHERED} is "
            "needed): this is no turning wheel, half black and half white"
        )
    at = start + (np.flatnonzero(good) * WINDOW_NS + WINDOW_NS // 2)
    at, angle = _to_the_ends(at, _smooth(at, np.unwrap(middle[good])))
    turns = abs(angle[-1] - angle[0]) / (2 * np.pi)
    if turns < LEAST_TURNS:
        raise NoWheel(f"the border turns by {turns:.2f} of a turn; {LEAST_TURNS} is needed")
    passed = np.bincount(found.pixel[inside], minlength=box[2] * box[3]).reshape(box[3], box[2]) > 0
    return Wheel(hub, at, angle, 1 if angle[-1] > angle[0] else -1, gathered, _filled(passed), box)


def _motion(found: Bursts) -> tuple[int, int]:
    """Finds the first and last time [ns] of the longest stretch in which bursts keep beginning."""
    if len(found.start) < LEAST_BURSTS:
        raise NoWheel(f"only {len(found.start)} bursts of events: nothing moves long enough")
    first = int(found.start.min())
    rate = np.bincount((found.start - first) // WINDOW_NS)
    busy = np.convolve(rate, np.ones(3) / 3, "same") >= max(
        BUSY * np.percentile(rate[rate > 0], BUSIEST), LEAST_BEGINNINGS
    )
    edges = np.flatnonzero(np.diff(np.concatenate([[0], busy.astype(int), [0]])))
    begins, ends = edges[::2], edges[1::2]
    for i in range(len(begins) - 1, 0, -1):  # what pauses for a moment is one motion
        if begins[i] - ends[i - 1] <= PAUSE:
            begins, ends = np.delete(begins, i), np.delete(ends, i - 1)
    longest = int(np.argmax([rate[b:e].sum() for b, e in zip(begins, ends)]))
    return first + int(begins[longest]) * WINDOW_NS, first + int(ends[longest]) * WINDOW_NS


def _angles(
    x: np.ndarray, y: np.ndarray, window: np.ndarray, shift: np.ndarray, hub: tuple[float, float]
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Computes the agreement over all, and per window the mean angle, its resultant length and the number of
    beginnings."""
    dx, dy = x - hub[0], y - hub[1]
    far = np.hypot(dx, dy) > NEAREST_PX
    unit = np.exp(1j * (np.arctan2(dy, dx)[far] + shift[far]))
    size = int(window.max()) + 1
    counts = np.bincount(window[far], minlength=size)
    total = np.bincount(window[far], unit.real, size) + 1j * np.bincount(window[far], unit.imag, size)
    length = np.abs(total)
    return float(length.sum() / max(len(unit), 1)), np.angle(total), length / np.maximum(counts, 1), counts


def _hub(
    x: np.ndarray, y: np.ndarray, window: np.ndarray, shift: np.ndarray, box: tuple[int, int, int, int]
) -> tuple[float, float]:
    """Searches for the point about which angles gather best, on ever finer grids; it may lie outside of the box."""
    step = max(box[2], box[3]) / FIRST_STEPS
    best, at = -1.0, (box[0] + box[2] / 2, box[1] + box[3] / 2)
    reach = FIRST_STEPS // 2 + 2  # beyond the box too
    while step > HUB_PX:
        around = at
        for j in range(-reach, reach + 1):
            for i in range(-reach, reach + 1):
                hub = (around[0] + i * step, around[1] + j * step)
                found = _angles(x, y, window, shift, hub)[0]
                if found > best:
                    best, at = found, hub
        step, reach = step / FINER, 2  # as far as the best of the coarser grid may be off
    return at


def _smooth(at: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Fits a parabola through each SMOOTH neighbours, and gives it at the middle one; ends as the last parabola has
    them."""
    out, half = angle.copy(), SMOOTH // 2
    for k in range(len(at)):
        first = min(max(k - half, 0), len(at) - SMOOTH)
        part = slice(first, first + SMOOTH)
        time = (at[part] - at[k]) * 1e-9
        out[k] = np.polyfit(time, angle[part], 2)[2]
    return out


def _to_the_ends(at: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolates the angle from the middles of the first and the last window to their outer ends."""
    slope = np.diff(angle)[[0, -1]] / np.diff(at)[[0, -1]]
    beyond = np.array([-WINDOW_NS // 2, WINDOW_NS // 2])
    ends, angles = at[[0, -1]] + beyond, angle[[0, -1]] + slope * beyond
    return np.concatenate([ends[:1], at, ends[1:]]), np.concatenate([angles[:1], angle, angles[1:]])


def _filled(passed: np.ndarray) -> np.ndarray:
    """Tells which pixels belong to the wheel: those where most of the nine about them were passed; hot and dead ones
    change nothing."""
    padded = np.pad(passed.astype(np.int64), 1, mode="edge")
    height, width = passed.shape
    near = sum(padded[j : j + height, i : i + width] for j in range(3) for i in range(3))
    return np.asarray(near >= 5)
