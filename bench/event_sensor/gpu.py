"""Measures frames and events a second of the ideal event sensor on a GPU, against its memory bandwidth, and atomics.

    python -m bench.event_sensor.gpu [--quick] [--json] [--device cuda]

Frames are on the device before and events stay there, in order. "one at a time" waits for the events of a call before
the next one; "in flight" has as many calls under way as the sensor takes.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.event_sensor import disk
from bench.event_sensor.room_kernels import take_room_alone
from bench.event_sensor.signals import SECOND
from evis.gpu.append_kernels import take_room
from nodes.event_sensor.cuda import ideal_kernels
from nodes.event_sensor.cuda.event_list import DeviceEventList
from nodes.event_sensor.cuda.ideal import IdealPasses
from nodes.event_sensor.readout.device_events import CALLS
from nodes.event_sensor.sensor import EventSensor

COMMAND = "python -m bench.event_sensor.gpu"
PERIOD = SECOND // 1000
ROUNDS = 3
FRAMES = 200
SPARSE = 1e-4
"""Share of the samples that change."""
ENVIRONMENTS = ((1, 640, 480), (8, 640, 480), (64, 640, 480), (1024, 128, 128), (1024, 346, 260))


class Loop:
    """Calls a sensor on the same frames over and over, with stamps that go on. images: [E, K, H, W] each."""

    def __init__(self, sensor: EventSensor, images: list[wp.array]) -> None:
        self._sensor, self._images, self._device = sensor, images, images[0].device
        self._frames = images[0].shape[1]
        self._now = 0
        self._episodes = np.zeros(sensor.envs, np.int32)

    def run(self, calls: int, in_flight: int) -> int:
        """Makes `calls` calls and returns the number of their events."""
        waiting: list[Any] = []
        events = 0
        steps = np.arange(1, self._frames + 1, dtype=np.int64) * PERIOD
        for i in range(calls):
            t = self._now + steps
            self._now = int(t[-1])
            image = self._images[i % len(self._images)]
            if in_flight == 1:
                events += self._sensor.advance(image, t, self._episodes)
                continue
            if len(waiting) == in_flight:
                events += waiting.pop(0).result().count
            waiting.append(self._sensor.process_async(image, t, self._episodes))
        return events + sum(pending.result().count for pending in waiting)

    def timed(self, calls: int, in_flight: int) -> tuple[float, int]:
        """Measures the least time of a call [us] in ROUNDS rounds, after one that compiles; also a round's events."""
        times = []
        for _ in range(1 + ROUNDS):
            wp.synchronize_device(self._device)
            started = time.perf_counter()
            events = self.run(calls, in_flight)
            wp.synchronize_device(self._device)
            times.append(time.perf_counter() - started)
        return 1e6 * min(times[1:]) / calls, events

    def device_time(self, calls: int, kernel: str) -> float:
        """Measures the median time [us] of kernels whose name contains `kernel`, launched one by one."""
        event_list = self._sensor._event_list
        assert isinstance(event_list, DeviceEventList)
        event_list.pipeline.records = False
        wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
        self.run(calls, 1)
        found = [r.elapsed for r in wp.timing_end() if kernel in r.name]
        event_list.pipeline.records = True
        return 1e3 * statistics.median(found)


def bandwidth(device: str) -> float:
    """Measures how many bytes a second a copy on the device reads and writes."""
    a: wp.array = wp.zeros(1 << 28, dtype=wp.float32, device=device)
    b = wp.zeros_like(a)
    times = []
    for _ in range(10):
        wp.synchronize_device(device)
        started = time.perf_counter()
        wp.copy(b, a)
        wp.synchronize_device(device)
        times.append(time.perf_counter() - started)
    return 2 * int(a.capacity) / min(times)


def disk_rows(quick: bool, device: str) -> list[dict[str, Any]]:
    """Measures the HDR disk, 640x480 at 1 kHz."""
    frames = disk.record((np.arange(FRAMES, dtype=np.int64) + 1) * PERIOD, soft=1.0).luminance
    rows = []
    for k in (1, 8, 50):
        images: list[wp.array] = [wp.array(frames[i : i + k][None], device=device) for i in range(0, FRAMES, k)]
        row: dict[str, Any] = {"frames a call": k}
        for label, in_flight in (("one at a time", 1), ("in flight", CALLS)):
            calls = FRAMES // k * (1 if quick else 5)
            us, events = Loop(EventSensor(480, 640, device=device), images).timed(calls, in_flight)
            row[f"{label}: us a call"] = round(us, 1)
            row[f"{label}: frames/s"] = round(1e6 * k / us)
            row[f"{label}: Mev/s"] = round(events / calls / us, 1)
        rows.append(row)
    return rows


def sparse_rows(quick: bool, device: str) -> list[dict[str, Any]]:
    """Measures pictures in which hardly anything changes.

    Floor: the time to read every sample once and to read and write a level of 4 bytes per pixel."""
    rate, calls = bandwidth(device), 20 if quick else 100
    rows = []
    for envs, width, height in ENVIRONMENTS:
        for k in (1, 8):
            if envs * width * height * k >= 1 << 29:
                continue
            images = sparse_frames(envs, k, height, width, device)
            loop = Loop(EventSensor(height, width, envs, device=device), images)
            us, events = loop.timed(calls, CALLS)
            floor = 1e6 * envs * height * width * (4 * k + 8) / rate
            rows.append(
                {
                    "environments": envs,
                    "size": f"{width}x{height}",
                    "frames a call": k,
                    "us a call": round(us, 1),
                    "floor [us]": round(floor, 1),
                    "ratio": round(us / floor, 2),
                    "frames/s": round(1e6 * envs * k / us),
                    "events a call": round(events / calls),
                }
            )
    return rows


def sparse_frames(envs: int, k: int, height: int, width: int, device: str) -> list[wp.array]:
    """Makes two messages of the same picture, in each of which other samples are brighter."""
    rng = np.random.default_rng(0)
    one = np.exp(rng.normal(0, 1, (1, 1, height, width))).astype(np.float32)
    still = np.broadcast_to(one, (envs, k, height, width))
    images: list[wp.array] = []
    for _ in range(2):
        frames = still.copy()
        frames.reshape(-1)[rng.integers(0, frames.size, max(int(SPARSE * frames.size), 1))] *= 1.5
        images.append(wp.array(frames, device=device))
    return images


def atomics_rows(quick: bool, device: str) -> list[dict[str, Any]]:
    """Measures noise in every pixel, with room for events taken by each warp together and by each pixel."""
    rng = np.random.default_rng(0)
    noise = (np.exp(rng.normal(0, 0.5, (1, 8, 480, 640))).astype(np.float32) for _ in range(4))
    images: list[wp.array] = [wp.array(frames, device=device) for frames in noise]
    calls = 8 if quick else 40
    rows = []
    for label, room in (("added up by a warp", take_room), ("by each pixel and step", take_room_alone)):
        sensor = EventSensor(480, 640, device=device)
        passes = sensor._engine
        assert isinstance(passes, IdealPasses)
        passes._kernel = ideal_kernels.make_sense_active(False, False, room)
        loop = Loop(sensor, images)
        us, events = loop.timed(calls, CALLS)
        rows.append(
            {
                "room for events": label,
                "events a call": round(events / calls),
                "us a call": round(us, 1),
                "of these the pass [us]": round(loop.device_time(8, "sense"), 1),
                "Mev/s": round(events / calls / us, 1),
            }
        )
    return rows


def measure(quick: bool = False, device: str = "cuda") -> dict[str, Any]:
    """Measures a dense, a sparse and a noisy picture on a CUDA device."""
    name = wp.get_device(device).name
    tables: dict[str, tuple[Callable[[bool, str], list[dict[str, Any]]], str, str]] = {
        "sensor": (
            disk_rows,
            f"Event sensor on {name}, HDR disk, 640x480 at 1 kHz",
            f"Ideal model, events sorted, staying on the device; in flight: {CALLS} calls.",
        ),
        "sensor_sparse": (
            sparse_rows,
            f"Event sensor on {name}, hardly any events",
            f"{CALLS} calls in flight; floor from a copy's bandwidth, measured in this run.",
        ),
        "sensor_dense": (
            atomics_rows,
            f"Event sensor on {name}, noise in every pixel, 640x480, 8 frames a call: what the atomics cost",
            "",
        ),
    }
    return {
        key: {"title": title, "command": COMMAND, "rows": rows(quick, device), "note": note}
        for key, (rows, title, note) in tables.items()
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="cuda")
