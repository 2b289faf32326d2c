"""Measures motion that is too fast for frames, with and without samples of single pixels between them.

python -m bench.interpolation.extremes [--quick]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bench import command
from bench.interpolation.cases import FOCAL, WIDTH, lamp, plain, scene_of, square, wall
from bench.interpolation.pipeline import reference, simulate
from evis.events.measure.distance import victor_purpura
from evis.geometry import se3
from evis.runtime.clock import NS
from evis.scene.model import Material, Scene, Waveform
from evis.scene.motion import Linear, Motion, Prescribed, Sinusoid, Spin
from nodes.interpolator.auto.world import World

RATE, GAPS = 31.25, 3
TRUTH_HZ = 16_000.0
WAYS = {
    "31x32 frames": ("rigid", RATE, 32, 0.0),
    "31x4, further samples": ("rigid", RATE, 4, 1e-4),
    "31x8, further samples": ("rigid", RATE, 8, 1e-4),
    "dense 1000 Hz": ("none", 32 * RATE, 1, 0.0),
}
"""Method, keyframes per second, K and time_tolerance [s]."""
DEPTH = 2.0
TURN = np.array([0.0, 0.0, 1.0])


def from_zero(place: Sequence[float], *motions: Motion) -> Prescribed:
    """Makes a body that is at `place` at t = 0."""
    return Prescribed(se3.make_pose(np.array(place, np.float64), se3.exp(np.zeros(3))), motions)


def pole() -> Scene:
    """Makes a pole 3 px wide that swings through the image, by up to 20 px in an eighth of a gap."""
    pace, half = 20.0 * 8 * RATE * DEPTH / FOCAL, 1.0
    swing = Sinusoid(np.array([half, 0.0, 0.0]), pace / (2 * np.pi * half))
    thing = (square(1.5 * DEPTH / FOCAL, 2.0), plain(0.9), from_zero((0, 0, DEPTH), swing))
    return scene_of([wall(material=plain(0.2)), thing])


def blade(rate: float) -> Scene:
    """Makes a bright blade that turns at `rate` [rad/s] before a painted wall."""
    return scene_of([wall(), (square(0.6, 0.06), plain(0.9), from_zero((0.3, 0.1, DEPTH), Spin(TURN, rate)))])


def fan() -> Scene:
    """Makes a fan beside the camera whose shadow sweeps over a wall."""
    blades = (square(0.3, 0.05), plain(0.5), from_zero((0.0, -0.7, 0.6), Spin(TURN, 60.0)))
    return scene_of([wall(), blades], lights=[lamp()], sky=0.02)


def fine_texture() -> Scene:
    """Makes a wall with stripes two thirds of a pixel wide that goes by at 40 px per gap."""
    period = 4.0 / 3.0 * 3.0 / FOCAL
    at = (np.arange(4096) + 0.5) / 4096 * 8.0
    stripes = np.broadcast_to(np.where(np.sin(2 * np.pi * at / period) > 0, 0.8, 0.2), (64, 4096))
    material = Material("stripes", np.ones(3), np.repeat(stripes[..., None], 3, -1).astype(np.float32), two_sided=True)
    pace = 40.0 * RATE * 3.0 / FOCAL
    return scene_of([(square(4.0), material, from_zero((-2.0, 0, 3.0), Linear(np.array([pace, 0.0, 0.0]))))])


def turning_camera() -> Scene:
    """Makes a camera that turns at up to 25 rad/s before thin columns."""
    places = np.linspace(-np.pi, np.pi, 60, endpoint=False)
    things = [(square(0.015, 3.0), plain(0.2), from_zero((2 * np.sin(a), 0, 2 * np.cos(a)))) for a in places]
    return scene_of(things, from_zero((0, 0, 0), Spin(np.array([0.0, 1.0, 0.0]), 25.0)))


def pulsed_lamp() -> Scene:
    """Makes a lamp that pulses at 240 Hz, on for a fifth of each period, over a turning blade and a passing square."""
    led = lamp(waveform=Waveform("square", 240.0, 0.9, 0.1, 0.2))
    square_goes = (square(0.15), plain(0.9), from_zero((-0.5, 0.3, DEPTH), Linear(np.array([10.0, 0.0, 0.0]))))
    blade_turns = (square(0.4, 0.05), plain(0.7), from_zero((0.3, -0.1, DEPTH), Spin(TURN, 40.0)))
    return scene_of([wall(), square_goes, blade_turns], lights=[led], sky=0.1)


def bullet() -> Scene:
    """Makes a square 10 px wide that crosses the image in 2 ms, between two frames of a gap."""
    pace = 106.0 * DEPTH / FOCAL / 2e-3
    flight = Linear(np.array([pace, 0.0, 0.0]))
    return scene_of([wall(), (square(5.0 * DEPTH / FOCAL), plain(0.9), from_zero((-pace * 0.018, 0.1, DEPTH), flight))])


def rods() -> Scene:
    """Makes rods beside the view, 2 cm wide, that fly before a lamp at up to 40 m/s: their shadows cross a wall."""
    things = [wall(material=plain(0.5))]
    for n, height in enumerate((-0.6, -0.7, -0.8)):
        fly = Sinusoid(np.array([1.0, 0.0, 0.0]), 40.0 / (2 * np.pi), 2.0 * n)
        things.append((square(0.01, 0.25), plain(0.2), from_zero((0.3 * n, height, 0.6 + 0.1 * n), fly)))
    return scene_of(things, lights=[lamp()], sky=0.05)


def torch() -> Scene:
    """Makes a lamp that goes at 20 m/s behind bars 2 cm wide, which stand still beside the view."""
    bars = [(square(0.01, 0.3), plain(0.2), from_zero((0.15 * n, -0.7, 0.6))) for n in range(-8, 9)]
    way = Sinusoid(np.array([0.5, 0.0, 0.0]), 40.0 / (2 * np.pi))
    things = [wall(material=plain(0.5)), *bars, (square(1e-3), plain(0.2), from_zero((0, 0, -9), way))]
    return scene_of(things, lights=[replace(lamp(), body=len(things) - 1, vector=np.array([0.0, -1.0, 9.0]))], sky=0.05)


SCENES: dict[str, Callable[[], Scene]] = {
    "pole, up to 20 px per eighth of a gap": pole,
    "propeller at 300 rad/s": lambda: blade(300.0),
    "fan before a lamp": fan,
    "texture finer than a pixel": fine_texture,
    "camera turning at 25 rad/s": turning_camera,
    "spinner at 10,000 rad/s": lambda: blade(10_000.0),
    "lamp pulsed at 240 Hz": pulsed_lamp,
    "square that crosses the image in 2 ms": bullet,
    "shadows of rods at 40 m/s": rods,
    "lamp at 20 m/s behind bars": torch,
}


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all ways on ten scenes; quick: on two, against 4 kHz."""
    duration, truth_hz = round(GAPS * NS / RATE), TRUTH_HZ / 4 if quick else TRUTH_HZ
    rows = []
    for name, make in list(SCENES.items())[: 2 if quick else None]:
        world = World(make(), duration)
        truth = reference(world, truth_hz, duration, NS)[0]
        line: dict[str, Any] = {"scene": name, "events": len(truth.t)}
        for way, (method, rate, upsampling, tolerance) in WAYS.items():
            warp = {"time_tolerance": tolerance} if tolerance else {}
            events = simulate(world, method, rate, upsampling, duration, warp=warp).streams["linear"]
            change = 100 * (len(events.t) / max(len(truth.t), 1) - 1)
            line[way] = f"{victor_purpura(events, truth, 1.0):.3f} ({change:+.1f} %)"
        rows.append(line)
    return {
        "extremes": {
            "title": f"Motion too fast for frames, {WIDTH} px wide: error (events too many)",
            "command": "python -m bench.interpolation.extremes",
            "rows": rows,
            "note": f"Victor-Purpura at 1/ms against dense rendering at {truth_hz:g} Hz, {GAPS} gaps of "
            f"{1e3 / RATE:g} ms.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
