"""Measures what further samples of single pixels cost in the sensor, beside frames alone on the same scene.

    python -m bench.event_sensor.further [--quick]

A texture that moves all over the image, 8 frames a message at 30 messages a second; a share of the pixels has further
samples between the frames. CPU seconds are process time of one core; ratios are of one run.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bench import command
from bench.event_sensor.sensing import section
from nodes.event_sensor.sensor import EventSensor, Further

HEIGHT, WIDTH, FRAMES, GAP = 260, 346, 8, 33_333_333
CASES = ((0.0, 0), (0.02, 16), (0.1, 16), (0.3, 16), (1.0, 4), (1.0, 16))
"""Share of the pixels that have further samples, and how many each has in a message."""
SENSORS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "dead time": {"refractory_us": 100.0},
    "photoreceptor, 300 Hz": {"bandwidth_hz": 300.0},
}


class Texture:
    """Computes a test signal whose ln I is the sum of eight waves that move over the image."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        waves = rng.normal(0, 0.12, (8, 2))
        self._phase = waves[:, 0, None, None] * x + waves[:, 1, None, None] * y + rng.uniform(0, 6.28, (8, 1, 1))
        self._speed = rng.normal(0, 60, (8, 1, 1))

    def light(self, t_ns: int) -> np.ndarray:
        """Computes the intensity at a time, float32 [H, W]."""
        level = 0.25 * np.sin(self._phase + self._speed * (t_ns * 1e-9)).sum(0)
        return np.exp(level).astype(np.float32)


def message(texture: Texture, k: int, share: float, samples: int) -> tuple[np.ndarray, np.ndarray, Further | None]:
    """Returns stamps, frames [1, K, H, W] and further samples of message k; None without any."""
    t = k * GAP + np.arange(1, FRAMES + 1) * GAP // FRAMES
    frames = np.stack([texture.light(int(now)) for now in t])[None]
    if not samples:
        return t, frames, None
    offset = np.setdiff1d(np.linspace(0, GAP, samples + 2)[1:-1].astype(np.int64), t - k * GAP)
    light = np.stack([texture.light(k * GAP + int(at)) for at in offset], -1).reshape(HEIGHT * WIDTH, -1)
    chosen = np.random.default_rng(k).random(HEIGHT * WIDTH) < share
    first = np.concatenate(([0], np.cumsum(np.where(chosen, len(offset), 0)))).astype(np.int32)
    return t, frames, Further(first, np.tile(offset, int(chosen.sum())).astype(np.int32), light[chosen].ravel())


def run(params: dict[str, Any], share: float, samples: int, messages: int) -> tuple[float, int, int]:
    """Returns CPU seconds of the quickest message, and how many further samples and events it has."""
    texture, episodes = Texture(3), np.zeros(1, np.int32)
    sensor = EventSensor(HEIGHT, WIDTH, **params)
    sensor.process(texture.light(0)[None, None], np.array([0]), episodes)
    spent = []
    for k in range(messages):
        t, frames, further = message(texture, k, share, samples)
        started = time.process_time()
        events = sensor.advance(frames, t, episodes, further=further)
        spent.append((time.process_time() - started, 0 if further is None else len(further.offset), events))
    return min(spent[1:])


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures ms a message, and what a further sample adds."""
    rows: list[dict[str, Any]] = []
    for name, params in SENSORS.items():
        base = 0.0
        for share, samples in CASES[:4] if quick else CASES:
            seconds, count, events = run(params, share, samples, 3 if quick else 8)
            base = base or seconds
            row: dict[str, Any] = {"sensor": name, "pixels with further samples [%]": 100 * share}
            row |= {"further samples": count, "events": events, "ms a message": round(1e3 * seconds, 2)}
            row |= {"Mev/s": round(events / seconds / 1e6, 1), "x frames alone": round(seconds / base, 2)}
            row["ns per further sample"] = round(1e9 * (seconds - base) / count, 1) if count else None
            rows.append(row)
    note = f"{WIDTH} x {HEIGHT}, {FRAMES} frames a message, one core; the quickest message of a run."
    return {"further_samples": section("Further samples between the frames", rows, note)}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
