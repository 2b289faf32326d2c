"""Drivers on emulated devices: make one, run it to its end, compare what came with what was sent."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from evis.events import Events, open_writer
from nodes.camera.emulated.bus import driver_on
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import LiveFeed
from nodes.camera.emulated.recording_feed import RecordingFeed
from nodes.camera.interface.driver import Reading
from nodes.camera.usb.driver import UsbDriver
from nodes.camera.usb.models import model_named

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
MS = 1_000_000


def random_recording(path: Path, width: int, height: int, n: int = 20_000, span_us: int = 400_000) -> Events:
    """A recording of uniform noise in order of time, whole us, one event per us and pixel; what was written."""
    rng = np.random.default_rng(7)
    t = np.sort(rng.choice(span_us - 1, n, replace=False) + 1) * 1000
    x, y = rng.integers(0, width, n, np.uint16), rng.integers(0, height, n, np.uint16)
    events = Events(t, x, y, rng.integers(0, 2, n, np.uint8))
    with open_writer(path, width, height) as writer:
        writer.write(events)
    return events


class HandClock:
    """The time of an emulated device that stands until the test moves it on."""

    def __init__(self) -> None:
        self.ns = 0
        self.begun = threading.Event()
        """The device has taken the time from which it counts."""

    def now(self) -> int:
        now = self.ns
        self.begun.set()
        return now

    def sleep(self, seconds: float) -> None:
        time.sleep(min(seconds, 1e-3))  # until the test has moved it on, maybe


def played(
    name: str, path: Path, faults: str = "", speed: float = 0.0, duration_s: float = 0.0, clock: Any = None
) -> UsbDriver:
    """A driver of the model whose emulated device sends a recording, not opened; at the pace of `clock`."""
    model = model_named(name)
    pace = {"now": clock.now, "sleep": clock.sleep} if clock else {}
    feed = RecordingFeed(str(path), model, speed, duration_s, **pace)
    return driver_on(model, feed, Faults.of(faults), live=speed == 1.0)


def silent(name: str, faults: str = "") -> UsbDriver:
    """A driver of the model whose emulated device sends nothing."""
    return driver_on(model_named(name), LiveFeed(), Faults.of(faults))


def run(driver: UsbDriver, steps: int = 20_000, **settings: Any) -> list[Reading]:
    """Open, configure, stream to the end, close."""
    readings = []
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy", **settings}))
        driver.start()
        for _ in range(steps):
            reading = driver.read(0.2)
            if reading is not None:
                readings.append(reading)
            elif driver.ended:
                return readings
    raise AssertionError("the stream does not end")


def joined(readings: list[Reading]) -> Events:
    """All readings' events, samples, frames and triggers in order."""
    return Events.concatenate([Events.empty(), *(r.events for r in readings)])


def same(a: Events, b: Events) -> bool:
    """Bit-equal events in the same order."""
    return len(a) == len(b) and all((getattr(a, n) == getattr(b, n)).all() for n in "txyp")
