"""Measures nanoseconds per event of representations, beside numpy as it is written elsewhere, and beside tonic.

`python -m bench.streams.representations`; in .venv-extras (`make test-extras`) tonic is measured too. Of every pair the
runs alternate, the fastest of each counts, and the results are compared.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench import command
from evis.events.representations import count_image, time_surface, voxel_grid

HEIGHT, WIDTH, BINS, TAU_NS = 260, 346, 5, 10_000_000
COMMAND = "python -m bench.streams.representations"
Make = Callable[[np.ndarray], np.ndarray]


def some_events(n: int) -> np.ndarray:
    """Draws n events all over the array in 0.1 s, in tonic's layout."""
    rng = np.random.default_rng(0)
    events = np.zeros(n, [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "i1")])
    events["t"] = np.sort(rng.integers(0, 100_000_000, n))
    events["x"], events["y"] = rng.integers(0, WIDTH, n), rng.integers(0, HEIGHT, n)
    events["p"] = rng.integers(0, 2, n)
    return events


def numpy_voxels(e: np.ndarray) -> np.ndarray:
    """Makes a voxel grid as E2VID's inference code does, by np.add.at."""
    grid = np.zeros(BINS * HEIGHT * WIDTH, np.float32)
    at = (BINS - 1) * (e["t"] - e["t"][0]).astype(float) / float(e["t"][-1] - e["t"][0])
    left, sign = at.astype(int), np.where(e["p"] > 0, 1.0, -1.0)
    part = at - left
    pixel = e["x"].astype(int) + e["y"].astype(int) * WIDTH + left * (WIDTH * HEIGHT)
    np.add.at(grid, pixel, sign * (1.0 - part))
    inside = left + 1 < BINS
    np.add.at(grid, pixel[inside] + WIDTH * HEIGHT, (sign * part)[inside])
    return grid.reshape(BINS, HEIGHT, WIDTH)


def numpy_counts(e: np.ndarray) -> np.ndarray:
    """Counts the events of each pixel and polarity by np.add.at."""
    image = np.zeros((2, HEIGHT, WIDTH), np.int32)
    np.add.at(image, (e["p"].astype(int), e["y"], e["x"]), 1)
    return image


def numpy_surface(e: np.ndarray) -> np.ndarray:
    """Makes a time surface by assignment, so that the last event of a pixel counts."""
    latest = np.full((2, HEIGHT, WIDTH), -np.inf)
    latest[e["p"].astype(int), e["y"], e["x"]] = e["t"]
    return np.exp((latest - e["t"][-1]) / TAU_NS).astype(np.float32)


def tonic_rows() -> dict[str, Make]:
    """Gives tonic's functions for the same results, none where it is not installed."""
    if importlib.util.find_spec("tonic") is None:
        return {}
    functional = importlib.import_module("tonic.functional")
    sensor = (WIDTH, HEIGHT, 2)
    return {
        # its grid of B bins is the first B of B + 1 (see tests/events/representations/test_tonic.py)
        "voxel grid": lambda e: functional.to_voxel_grid_numpy(e.copy(), sensor, BINS - 1)[:, 0],
        "count image": lambda e: functional.to_frame_numpy(e, sensor, n_event_bins=1)[0],
    }


def cases() -> list[tuple[str, Make, dict[str, Make]]]:
    """Lists name, ours, and the others by name."""
    size: Any = {"height": HEIGHT, "width": WIDTH}
    theirs = tonic_rows()
    rows: list[tuple[str, Make, dict[str, Make]]] = [
        ("voxel grid", lambda e: voxel_grid(e, BINS, **size).values, {"numpy": numpy_voxels}),
        ("count image", lambda e: count_image(e, **size).values, {"numpy": numpy_counts}),
        ("time surface", lambda e: time_surface(e, TAU_NS, **size).values, {"numpy": numpy_surface}),
    ]
    return [(n, ours, others | ({"tonic": theirs[n]} if n in theirs else {})) for n, ours, others in rows]


def seconds(calls: dict[str, Make], events: np.ndarray, rounds: int) -> dict[str, float]:
    """Times every call in turn, `rounds` times; the fastest of each."""
    best = dict.fromkeys(calls, float("inf"))
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            call(events)
            best[name] = min(best[name], time.process_time() - start)
    return best


def measure(quick: bool) -> dict[str, Any]:
    """Measures every representation on packets of two sizes."""
    rows = []
    for n in (20_000, 200_000) if quick else (20_000, 1_000_000):
        events = some_events(n)
        for name, ours, others in cases():
            made = ours(events)  # compiles, too
            for other, call in others.items():
                expected = call(events)
                if not np.allclose(made[: len(expected)], expected, atol=1e-3):
                    raise ValueError(f"{name}: {other} gives something else")
            best = seconds({"evis": ours, **others}, events, 5 if quick else 15)
            row = {"what": name, "events": n, "ns/event": round(best["evis"] / n * 1e9, 1)}
            rows.append(row | {f"{other} / evis": round(best[other] / best["evis"], 1) for other in others})
    about = (
        "346x260, five bins; ratios of one run, CPU time: how many times longer the other takes for the same result."
    )
    section = {"title": "Representations of events", "command": COMMAND, "rows": rows, "note": about}
    return {"representations": section}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
