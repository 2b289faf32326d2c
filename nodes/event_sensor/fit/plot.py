"""Draws a fit: what was recorded beside what the fitted sensor makes of the same scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.events.measure.bursts import bursts_of
from nodes.event_sensor.fit.clip import BEFORE_NS, STEP_NS, Light, simulate, some_pixels
from nodes.event_sensor.fit.fit import Compared, Fit
from nodes.event_sensor.fit.statistics import TEXTS

REAL, MADE = "#30343f", "#d1495b"
SOME = 2000
"""Pixels of the wheel that are drawn."""


def draw(fit: Fit, light: Light, path: str) -> None:
    """Writes the picture: statistics of every recording, then intervals, bursts and rate of the first one."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(14, 7.5), layout="constrained")
    _statistics(axes[0, 0], fit)
    _noise(axes[0, 1], fit)
    shown = next((one for one in fit.compared if not one.fitted), fit.compared[0])
    real, made = _events(shown, fit, light)
    _rate(axes[0, 2], shown, real, made)
    for axis, side, name in ((axes[1, 0], 1, "ON"), (axes[1, 1], 0, "OFF")):
        _intervals(axis, real, made, side, name)
    _bursts(axes[1, 2], real, made)
    told = "was not fitted" if not shown.fitted else "was fitted"
    figure.suptitle(f"lower row and rate: {shown.clip.name}, which {told}", fontsize=10)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _events(one: Compared, fit: Fit, light: Light) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Gives (t, pixel, p) of the same pixels, recorded and simulated."""
    clip, wheel = one.clip, one.clip.wheel
    x, y = some_pixels(clip, SOME)
    start, end = wheel.start_ns - BEFORE_NS, wheel.end_ns
    index = np.full((wheel.box[3], wheel.box[2]), -1)
    index[(y - wheel.box[1]).astype(int), (x - wheel.box[0]).astype(int)] = np.arange(len(x))
    first, last = np.searchsorted(clip.t, [start, end])
    column, row = clip.x[first:last].astype(int) - wheel.box[0], clip.y[first:last].astype(int) - wheel.box[1]
    pixel = index[row, column]
    keep = pixel >= 0
    real = clip.t[first:last][keep], pixel[keep], clip.p[first:last][keep]
    times = np.arange(start, end, STEP_NS, dtype=np.int64)
    return real, simulate(clip, light, one.blur, fit.values, times, x, y, 3)


def _statistics(axis: Any, fit: Fit) -> None:
    names = list(TEXTS)
    told: set[bool] = set()
    for k, one in enumerate(fit.compared):
        ratios = [one.simulated[name] / one.real[name] if one.real[name] > 0 else np.nan for name in names]
        place = np.arange(len(names)) + (k - (len(fit.compared) - 1) / 2) * 0.1
        label = None if one.fitted in told else f"recordings, {'' if one.fitted else 'not '}fitted"
        told.add(one.fitted)
        axis.plot(ratios, place, "o" if one.fitted else "s", mfc=MADE if one.fitted else "none", mec=MADE, label=label)
    axis.axvspan(0.8, 1.2, color="0.92", zorder=0)
    axis.axvline(1, color="0.6", lw=1)
    axis.set_yticks(range(len(names)), [TEXTS[name] for name in names], fontsize=8)
    axis.set_xlim(0.5, 1.5)
    axis.invert_yaxis()
    axis.set_xlabel("simulated / recorded (grey: within 20 %)")
    axis.legend(fontsize=7, loc="lower right")


def _noise(axis: Any, fit: Fit) -> None:
    sides = [("black", fit.noise.black), ("white", fit.noise.white)]
    for k, (_, side) in enumerate(sides):
        for rate, colour, shift, name in zip(side.rates, ("#c0392b", "#2471a3"), (-0.15, 0.15), ("ON", "OFF")):
            axis.bar(k + shift, max(rate, 1e-4), 0.28, color=colour, label=name if k == 0 else None)
    place = np.arange(len(fit.compared)) * 0.16 + 2
    axis.plot(place, [one.real_noise for one in fit.compared], "o", color=REAL, label="recorded, all")
    axis.plot(place, [max(one.simulated_noise, 1e-4) for one in fit.compared], "x", color=MADE, label="simulated, all")
    axis.set_yscale("log")
    axis.set_xticks([0, 1, float(place.mean())], ["black", "white", "wheel"])
    axis.set_ylabel("noise where nothing moves [Hz a pixel]")
    axis.legend(fontsize=7)


def _rate(axis: Any, one: Compared, real: tuple[Any, ...], made: tuple[Any, ...]) -> None:
    start = one.clip.wheel.start_ns
    edges = np.arange(0, (one.clip.wheel.end_ns - start) * 1e-9, 0.01)
    for (t, _, p), colour, name in ((real, REAL, "recorded"), (made, MADE, "simulated")):
        for side, style in ((1, "-"), (0, ":")):
            counts, _ = np.histogram((t[p == side] - start) * 1e-9, edges)
            label = f"{name} {'ON' if side else 'OFF'}"
            axis.plot(edges[:-1], counts / 0.01 / SOME, style, color=colour, lw=1.2, label=label)
    axis.set_xlabel("time since the motion began [s]")
    axis.set_ylabel("events / s and pixel")
    axis.legend(fontsize=7)


def _intervals(axis: Any, real: tuple[Any, ...], made: tuple[Any, ...], side: int, name: str) -> None:
    bins = np.geomspace(0.3, 30, 60)
    for events, colour, label in ((real, REAL, "recorded"), (made, MADE, "simulated")):
        found = bursts_of(*events)
        values = found.interval[found.interval_p == side] * 1e-6
        axis.hist(values, bins, density=True, histtype="step", color=colour, label=label)
    axis.set_xscale("log")
    axis.set_xlabel(f"interval inside bursts, {name} [ms]")
    axis.legend(fontsize=7)


def _bursts(axis: Any, real: tuple[Any, ...], made: tuple[Any, ...]) -> None:
    bins = np.linspace(0, 40, 61)
    for events, colour, label in ((real, REAL, "recorded"), (made, MADE, "simulated")):
        found = bursts_of(*events)
        for side, style in ((1, "-"), (0, ":")):
            values = found.length[found.p == side] * 1e-6
            axis.hist(values, bins, density=True, histtype="step", color=colour, ls=style,
                      label=f"{label} {'ON' if side else 'OFF'}")  # fmt: skip
    axis.set_xlabel("length of a burst [ms]")
    axis.legend(fontsize=7)
