"""Measures error and CPU time of `evis events measure` on disks that turn by a known angle.

    python -m bench.measure.disks [--quick]

A pixel has an event whenever a radial edge of the disk passes over it; the crossing times are found on the angle
itself, so that the true speed is known at every time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench import command
from evis.events.measure import Measurement

COMMAND = "python -m bench.measure.disks"
GRID_S = 2e-5
JITTER_S = 2e-4
BLOCK = 200_000
Edges = list[tuple[float, float, float, int]]


@dataclass(frozen=True)
class Case:
    """Describes a disk.

    omega(t): speed [rad/s] at t [s]; edges: (angle, inner, outer radius [px], polarity); tilt [deg].
    """

    name: str
    omega: Callable[[np.ndarray], np.ndarray]
    edges: Edges
    seconds: float = 0.6
    size: tuple[int, int] = (120, 100)
    pivot: tuple[float, float] = (60.0, 50.0)
    tilt: float = 0.0
    noise_hz: float = 0.0


def texture(radius: float = 44.0) -> Edges:
    """Makes 24 radial edges at random places, which come again only after a full turn."""
    random = np.random.default_rng(3)
    inner = random.uniform(0.11, 0.8, 24) * radius
    outer = inner + random.uniform(0.14, 0.32, 24) * radius
    angles, polarity = random.uniform(0, 2 * np.pi, 24), random.integers(0, 2, 24)
    return list(zip(angles.tolist(), inner.tolist(), outer.tolist(), polarity.tolist()))


def sectors(count: int, radius: float = 44.0) -> Edges:
    """Makes black and white sectors, `count` of each."""
    return [(np.pi * k / count, 0.14 * radius, radius, k % 2) for k in range(2 * count)]


def events(case: Case) -> tuple[np.ndarray, ...]:
    """Computes the events of a disk: t int64 [n] ns ascending, x, y uint16, p uint8."""
    random = np.random.default_rng(0)
    width, height = case.size
    rows, columns = np.mgrid[0:height, 0:width]
    across, down = (columns - case.pivot[0]).ravel(), (rows - case.pivot[1]).ravel()
    down = down / np.cos(np.radians(case.tilt))
    radius, angle = np.hypot(across, down), np.arctan2(down, across)
    grid = np.arange(0, case.seconds, GRID_S)
    speed = case.omega(grid)
    turned = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * GRID_S)])
    turns = np.flatnonzero(np.diff(np.sign(speed)) != 0) + 1
    parts = []
    for first, last in zip([0, *turns.tolist()], [*turns.tolist(), len(grid) - 1]):
        way, at = turned[first : last + 1], grid[first : last + 1]
        rising = way[-1] > way[0]
        way, at = (way, at) if rising else (way[::-1], at[::-1])
        for start, inner, outer, polarity in case.edges:
            where = np.flatnonzero((radius > inner) & (radius < outer))
            for turn in range(int((way[0] - 8) // (2 * np.pi)), int((way[-1] + 8) // (2 * np.pi)) + 2):
                wanted = angle[where] - start + 2 * np.pi * turn
                hit = (wanted > way[0]) & (wanted <= way[-1])
                t = np.interp(wanted[hit], way, at) + random.normal(0, JITTER_S, int(hit.sum()))
                parts.append((t, where[hit], np.full(len(t), polarity if rising else 1 - polarity)))
    count = random.poisson(case.noise_hz * case.seconds * width * height)
    noise = random.uniform(0, case.seconds, count), random.integers(0, width * height, count)
    parts.append((*noise, random.integers(0, 2, count)))
    t, place, p = (np.concatenate([part[i] for part in parts]) for i in range(3))
    keep = np.flatnonzero((t >= 0) & (t < case.seconds))
    keep = keep[np.argsort(t[keep], kind="stable")]
    t, place, p = t[keep], place[keep], p[keep]
    x, y = (place % width).astype(np.uint16), (place // width).astype(np.uint16)
    return np.round(t * 1e9).astype(np.int64), x, y, p.astype(np.uint8)


def cases(quick: bool) -> list[Case]:
    """Lists the disks that are measured, from those that it should manage to those beyond its range."""
    at = lambda speed: lambda t: speed + 0 * t
    result = [Case(f"texture, {w} rad/s", at(w), texture(), float(np.clip(12 / w, 0.4, 2))) for w in (5, 20, 200)]
    result += [Case(f"{n} sectors, {w} rad/s", at(w), sectors(n)) for n, w in ((1, 30), (12, 30), (6, 200), (12, 280))]
    if quick:
        return result
    result += [Case(f"texture, {w} rad/s", at(w), texture(), 2.0) for w in (0.3, 1, 2)]
    result += [Case(f"texture, tilt {d} deg", at(30.0), texture(), tilt=d) for d in (20.0, 40.0, 60.0, 70.0)]
    result += [Case("texture, tilt 60 deg, 0.57 revolutions", at(30.0), texture(), 0.12, tilt=60.0)]
    result += [Case("texture, tilt 60 deg, 100 rad/s", at(100.0), texture(), tilt=60.0)]
    result += [Case(f"texture, noise {r} Hz/px", at(30.0), texture(), noise_hz=r) for r in (1.0, 50.0)]
    for size in ((346, 260), (1280, 720)):
        middle = (size[0] / 2 + 5, size[1] / 2 - 4)
        result.append(Case(f"texture, {size[0]}x{size[1]}", at(30.0), texture(0.44 * size[1]), 0.5, size, middle))
    result.append(Case("texture, pivot at the border", at(30.0), texture(60.0), pivot=(119.0, 50.0)))
    result.append(Case("texture, 60 px in 640x480", at(30.0), texture(30.0), 0.5, (640, 480), (190.0, 190.0)))
    result.append(Case("texture, 10 to 90 rad/s in 1 s", lambda t: 10 + 80 * t, texture(), 1.0))
    result.append(Case("texture, 35 cos(6 t) rad/s", lambda t: 35 * np.cos(6 * t), texture(), 1.0))
    return result


def row(case: Case) -> dict[str, Any]:
    """Measures the speed of one disk from its events; returns a row of the table."""
    t, x, y, p = events(case)
    began = time.process_time()
    measurement = Measurement(*case.size)
    for i in range(0, len(t), BLOCK):
        measurement.add(*(v[i : i + BLOCK] for v in (t, x, y, p)))
    found = measurement.report()["rotation"]
    cpu = time.process_time() - began
    result = {"disk": case.name, "events": len(t), "confidence": found["confidence"], "CPU [s]": round(cpu, 1)}
    if found["omega_rad_s"] is None:
        return result | {"speed": "none stated", "error of the speed": "-", "p95 of the series": "-"}
    series = np.array(found["series"])
    # where the rotation reverses, a share of the speed says nothing
    floor = min(5.0, float(np.abs(case.omega(np.linspace(0, case.seconds, 1000))).mean()))
    true = case.omega(series[:, 0] * 1e-9) * (1 if found["direction"] == "clockwise" else -1)
    error = np.abs(series[:, 1] - true) / np.maximum(np.abs(true), floor)
    off = found["omega_rad_s"] / np.abs(true).mean() - 1
    result |= {"speed": round(found["omega_rad_s"], 2), "error of the speed": f"{100 * off:+.1f} %"}
    return result | {"p95 of the series": f"{100 * np.percentile(error, 95):.1f} %"}


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures error, confidence and CPU time by disk."""
    note = (
        "Errors of a series are relative to the true speed at that time, but to 5 rad/s, or the mean, where it is less."
    )
    section = {"title": "Rotation speed of disks whose speed is known", "note": note}
    return {"measure": section | {"command": COMMAND, "rows": [row(case) for case in cases(quick)]}}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
