"""Measures error and run time of events of video, with and without sub-frames, against the same scenes at 2 kHz.

    python -m bench.event_sensor.video [--quick]

Scenes are closed forms, rendered at any time: a texture that slides, one that turns, a textured ball before a texture
at rest, each as linear floats and in 8 bits of sRGB. Needs OpenCV (pip install 'evis[video]').
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench import command
from evis.events.measure.distance import EventStream, count_error, victor_purpura
from evis.media.colour import linear_from_srgb, srgb_from_linear
from evis.media.frames.source import FrameBlock
from nodes.event_sensor.simulate import simulate_frames
from nodes.interpolator.video.upsample import Upsampler

COMMAND = "python -m bench.event_sensor.video"
WIDTH, HEIGHT = 160, 120
SECONDS = 0.3
REFERENCE_HZ = 2000
THRESHOLD = 0.2
PER_MS = 0.1
"""Cost of a shift in the Victor-Purpura distance: events more than 20 ms apart are not the same."""
Scene = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Computes the radiance at (x, y) px of a sum of sinusoids of about 10 px and more in all directions, below 1."""
    rng = np.random.default_rng(1)
    waves, phases = rng.normal(size=(16, 2)) * 0.3, rng.uniform(0, 2 * np.pi, 16)
    level = np.zeros_like(x)
    for (k, m), phase in zip(waves, phases):
        level += np.sin(k * x + m * y + phase)
    return np.asarray(0.15 * np.exp(0.25 * level))


def slide(t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Computes the radiance at t [s] and (x, y) px of a texture that slides at 134 px/s."""
    return texture(x - 120 * t, y + 60 * t)


def turn(t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Computes the radiance at t [s] and (x, y) px of a texture that turns at 3 rad/s, 300 px/s in the corners."""
    c, s = np.cos(3 * t), np.sin(3 * t)
    x, y = x - WIDTH / 2, y - HEIGHT / 2
    return texture(c * x + s * y, c * y - s * x)


def ball(t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Computes the radiance of a textured ball of 20 px radius that moves at up to 450 px/s before a still texture."""
    u, v = 200 * t, 20 * np.sin(20 * t)
    inside = 1 / (1 + np.exp(np.clip(np.hypot(x - 40 - u, y - 60 - v) - 20, -50, 50)))
    return texture(x, y) * (1 - inside) + inside * texture(x - u + 300, y - v + 70)


SCENES: dict[str, Scene] = {"slide": slide, "turn": turn, "ball": ball}


def rendered(scene: Scene, stamps: np.ndarray, coded: bool = False) -> np.ndarray:
    """Renders frames float32 [T, H, W]; coded: through 8 bits of sRGB."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    frames = np.stack([scene(int(t) / 1e9, x, y) for t in stamps])
    if coded:
        frames = linear_from_srgb(np.round(srgb_from_linear(np.clip(frames, 0, 1)) * 255) / 255)
    return frames.astype(np.float32)


def stamps_at(rate: float) -> np.ndarray:
    """Lists the times of frames at a rate, int64 ns."""
    return np.array([round(i * 1e9 / rate) for i in range(round(SECONDS * rate) + 1)])


def sensed(frames: np.ndarray, stamps: np.ndarray) -> tuple[EventStream, float]:
    """Returns the events, and the sensor's time [s]."""
    began = time.process_time()
    events = simulate_frames(frames, stamps, threshold=THRESHOLD)
    spent = time.process_time() - began
    t, x, y, p = (events[name] for name in "txyp")
    return EventStream(t, x, y, p, WIDTH, HEIGHT), spent


def rows(name: str, rates: tuple[float, ...], coded: bool) -> list[dict[str, Any]]:
    """Measures one scene at some rates."""
    dense = stamps_at(REFERENCE_HZ)
    whole = rendered(SCENES[name], dense)
    truth, _ = sensed(whole, dense)
    about = {"scene": name, "frames": "8 bit" if coded else "float"}
    found = []
    for rate in rates:
        stamps = stamps_at(rate)
        frames = rendered(SCENES[name], stamps, coded)
        plain, spent = sensed(frames, stamps)
        error = victor_purpura(plain, truth, PER_MS)
        found.append(about | _figures(rate, "none", plain, truth, spent))
        upsampler = Upsampler()
        began = time.process_time()
        blocks = list(upsampler.blocks(iter([FrameBlock(stamps, frames)])))
        made = time.process_time() - began
        finer, spent = sensed(np.concatenate([b.image for b in blocks]), np.concatenate([b.t for b in blocks]))
        told = upsampler.report()
        line = about | _figures(rate, "auto", finer, truth, spent + made)
        line |= {"times nearer": round(error / victor_purpura(finer, truth, PER_MS), 1)}
        line |= {
            "motion [px]": told["largest_motion_px"],
            "flow agrees [%]": round(100 * (told["flow_agrees"] or 0), 1),
        }
        found.append(line)
    if not coded:
        found.append(about | _figures(REFERENCE_HZ // 2, "none", *_half(whole, dense, truth)))
    return found


def _half(frames: np.ndarray, stamps: np.ndarray, truth: EventStream) -> tuple[EventStream, EventStream, float]:
    """The reference at half its rate: what it is worth itself."""
    events, spent = sensed(np.ascontiguousarray(frames[::2]), stamps[::2])
    return events, truth, spent


def _figures(rate: float, upsample: str, events: EventStream, truth: EventStream, spent: float) -> dict[str, Any]:
    return {
        "rate [Hz]": rate, "--upsample": upsample, "VP error": round(victor_purpura(events, truth, PER_MS), 3),
        "count error [%]": round(100 * count_error(events, truth), 1), "CPU [ms/frame]": round(
            1e3 * spent / (SECONDS * rate), 1),
    }  # fmt: skip


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures every scene at common rates of video."""
    simulate_frames(np.ones((2, 8, 8), np.float32), np.array([0, 1000]))  # compiled before anything is timed
    warm = rendered(slide, stamps_at(30)[:2])
    list(Upsampler().blocks(iter([FrameBlock(stamps_at(30)[:2], warm)])))
    rates = (30.0,) if quick else (30.0, 60.0, 120.0)
    lines = [row for coded in (False, True) for name in SCENES for row in rows(name, rates, coded)]
    note = (
        f"{WIDTH}x{HEIGHT}, {SECONDS} s, threshold {THRESHOLD}; VP: Victor-Purpura distance over the events of both, 0 "
        f"to 1, {PER_MS} per ms. CPU: sub-frames and sensor, per frame of the source."
    )
    return {"video": {"title": "Events of video, upsampled or not", "note": note, "command": COMMAND, "rows": lines}}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
