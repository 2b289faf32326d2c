"""Whole graphs at the ends of their ranges, as a user starts them: counts and times against closed forms."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import Result

from evis.bag.reader import BagReader

WIDTH, HEIGHT = 8, 6
PIXELS = WIDTH * HEIGHT
WALL = """args:
  f: {default: 1, min: 0, max: 1e9, help: frequency}
  d: {default: 0.5, min: 0, max: 1, help: depth}
  i: {default: 3.14159265, min: 0, max: 1e30, help: irradiance}
cameras: {cam0: {position: [0, -1, 0], look_at: [0, 0, 0], fov: 40 deg}}
timestep: TIMESTEP
world: [{name: wall, shape: plane, size: [9, 9], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: white}]
materials: {white: {albedo: 1}}
lights: {sun: {kind: directional, direction: [0, 1, 0], irradiance: "${i}",
               flicker: {kind: sine, frequency: "${f}", depth: "${d}"}}}
"""
Launch = Callable[..., tuple[dict[str, Any], np.ndarray, str]]


@pytest.fixture
def launch(evis: Callable[..., Result], tmp_path: Path) -> Launch:
    """Run the wall: the summary, the times of the events of the first pixel [ns], and what was said."""

    def run(duration: float, timestep: float = 1e-3, **arguments: Any) -> tuple[dict[str, Any], np.ndarray, str]:
        (tmp_path / "wall.yaml").write_text(WALL.replace("TIMESTEP", str(timestep)))
        given = {"width": WIDTH, "height": HEIGHT} | arguments
        words = [f"{name}:={value}" for name, value in given.items()]
        done = evis(
            "launch", "wall.yaml", *words, "--duration", str(duration), "--compose", "--no-view", "--json",
            "--record", "run.mcap",
        )  # fmt: skip
        assert done.code == 0, done.err
        times = []
        with BagReader(tmp_path / "run.mcap") as bag:
            for _, message in bag.messages(["/cam0/events"]) if given.get("envs", 1) == 1 else ():
                first = (np.asarray(message.x) == 0) & (np.asarray(message.y) == 0)
                times.append(np.asarray(message.t)[first])
        return json.loads(done.out), np.concatenate(times) if times else np.zeros(0, np.int64), done.err

    return run


def crossings(frequency: float, threshold: float, duration: float) -> np.ndarray:
    """Times [s] at which ln(1 + sin(2 pi f t) / 2) meets the next multiple of the threshold, within a duration.

    In a period it rises to the k-th level at arcsin(2 (e^(k C) - 1)), falls to it at pi minus that, and below 0 alike.
    """
    up = np.arange(1, int(np.log(1.5) / threshold) + 1)
    down = np.arange(1, int(np.log(2) / threshold) + 1)
    rise = np.arcsin(2 * np.expm1(up * threshold))
    fall = np.arcsin(2 * np.expm1(-down * threshold))
    # Of the way down the first level is the one below the highest, of the way back the one above the lowest.
    back_down = np.pi - np.arcsin(2 * np.expm1((up - 1) * threshold))
    back_up = 2 * np.pi + np.arcsin(2 * np.expm1(-(down - 1) * threshold))
    angles = np.sort(np.concatenate([rise, back_down, np.pi - fall, back_up]))
    periods = np.arange(int(frequency * duration) + 1)
    times = ((2 * np.pi * periods[:, None] + angles) / (2 * np.pi * frequency)).ravel()
    return times[times <= duration * (1 + 1e-12)]


@pytest.mark.parametrize(
    "frequency, keyframe_rate, upsampling, duration, off_us, more",
    [
        (100, 30, 64, 0.1, 170, {}),
        (100, 30, 64, 0.1, 5, {"crossing": "cubic"}),
        (10, 30, 1000, 0.1, 1, {"width": 1, "height": 1}),
        (100, 10_000, 1, 0.02, 6, {}),
        (10_000, 1000, 256, 0.002, 1, {"i": 3e-6}),
        (1e5, 1e6, 4, 1e-4, 0.5, {"i": 3e6}),
    ],
)
def test_flicker_gives_its_crossings(
    launch: Launch,
    frequency: float,
    keyframe_rate: float,
    upsampling: int,
    duration: float,
    off_us: float,
    more: dict[str, Any],
) -> None:
    """10 Hz to 100 kHz, K = 1 to 1000, radiance 1e-6 to 1e6, 1 px to 8: every event, at its time."""
    summary, times, said = launch(
        duration, f=frequency, keyframe_rate=keyframe_rate, upsampling=upsampling, threshold=0.19, **more
    )
    expected = crossings(frequency, 0.19, duration)
    pixels = more.get("width", WIDTH) * more.get("height", HEIGHT)
    assert summary["events"] == len(expected) * pixels and summary["drops"] == 0 and said == ""
    assert np.abs(times * 1e-9 - expected).max() < off_us * 1e-6


@pytest.mark.slow
def test_times_beyond_what_a_double_counts_in_nanoseconds(launch: Launch) -> None:
    """104 days are 2^53 ns: a light of 9 hours' period, a keyframe every quarter of an hour, for 115 days.

    The last period has the stamps of the first, moved by whole periods, to the nanosecond's rounding of keyframes.
    """
    period = 32_000
    summary, times, _ = launch(1e7, 1000, f=1 / period, keyframe_rate=0.001, upsampling=1, width=1, height=1)
    assert summary["sim_s"] == 1e7 and times[-1] > 2**53
    count = len(crossings(1 / period, 0.2, period))
    last, first = (np.sort(part % (period * 10**9)) for part in (times[-count:], times[:count]))
    np.testing.assert_allclose(last, first, rtol=0, atol=50)
    assert np.all(np.diff(times) > 0) and summary["events"] == len(times)


@pytest.mark.parametrize("frequency", [120, 10_000])
def test_flicker_that_frames_cannot_show_is_said(launch: Launch, frequency: float) -> None:
    """At 240 frames per second what comes out is no flicker of that frequency, and that is said, once."""
    _, times, said = launch(0.1, f=frequency)
    assert len(times) < 0.9 * len(crossings(frequency, 0.2, 0.1))
    assert said.count("light 'sun' flickers at") == 1 and f"{frequency} Hz and frames come at 240 Hz" in said


@pytest.mark.slow
def test_leaks_and_noise_at_the_top_of_their_ranges(launch: Launch) -> None:
    """Leak of 1e4 Hz, a thousand to a step, is periodic; noise of 1e4 Hz with 100 us of dead time is halved, and of
    a dead time of ten seconds each pixel has one event."""
    summary, _, _ = launch(0.1, d=0, leak_rate=1e4)
    assert summary["events"] == PIXELS * 1000
    summary, times, _ = launch(0.1, d=0, shot_rate=1e4, shot_white=1e9, refractory_us=100)
    # A renewal process: variance of the count = mean x (waiting time's deviation / mean)^2 = mean / 4.
    expected = PIXELS * 0.1 / (100e-6 + 1e-4)
    assert abs(summary["events"] - expected) < 5 * np.sqrt(expected / 4)
    assert np.diff(times).min() >= 100_000
    summary, _, _ = launch(0.1, d=0, shot_rate=1e4, shot_white=1e9, refractory_us=1e7)
    assert summary["events"] == PIXELS


@pytest.mark.slow
def test_two_hundred_and_fifty_six_environments(launch: Launch) -> None:
    """Without noise all are alike, so there are 256 times the events."""
    one, _, _ = launch(0.1, f=30, upsampling=16)
    many, _, _ = launch(0.1, f=30, upsampling=16, envs=256)
    assert one["events"] > 0 and many["events"] == 256 * one["events"] and many["drops"] == 0
