"""Makes sensors by name, feeds them a recording, and makes the sections of the report on the event sensor."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.event_sensor.peers import EsimCore
from bench.event_sensor.signals import Recording
from evis.events.measure.distance import EventStream
from nodes.event_sensor.parameters import CROSSINGS
from nodes.event_sensor.peers import Model, make_model
from nodes.event_sensor.readout.packet import Events
from nodes.event_sensor.sensor import EventSensor

COMMAND = "evis bench event_sensor"
C = 0.2
FRAMES_A_CALL = 8
QUIET_VOLTMETER = {"k2": 0.0, "k3": 1e-6, "k4": 0.0, "k5": 0.0, "k6": 1e-6}
"""DVS-Voltmeter with hardly any noise and no dark level."""
MODELS: dict[str, dict[str, Any]] = {"esim": {}, "v2e": {}, "dvs_voltmeter": QUIET_VOLTMETER}
Make = Callable[[int, int], EventSensor | Model]


def evis(**params: Any) -> Make:
    """Makes the sensor of this project with these parameters."""
    return lambda height, width: EventSensor(height, width, **{"threshold": C, **params})


def model(name: str, **params: Any) -> Make:
    """Makes another published model with these parameters."""
    return lambda height, width: make_model(name, height, width, **{"threshold": C, **params})


def sense(
    make: Make, frames: Recording, slopes: bool = False, a_call: int = FRAMES_A_CALL
) -> tuple[EventStream, float]:
    """Runs a sensor on a recording, `a_call` frames a call after the first one: its events, and CPU seconds."""
    _, height, width = frames.luminance.shape
    episodes = np.zeros(1, np.int32)

    def feed(sensor: EventSensor | Model, part: slice) -> Events:
        images, t = frames.luminance[None, part], frames.t[part]
        more: dict[str, Any] = {"dlog_dt": frames.dlog_dt[None, part]} if slopes else {}
        return sensor.process(images, t, episodes, **more)

    warm = make(height, width)
    for first in range(3):
        feed(warm, slice(first, first + 1))
    sensor = make(height, width)
    started = time.process_time()
    parts = [feed(sensor, slice(0, 1))]
    parts += [feed(sensor, slice(first, first + a_call)) for first in range(1, len(frames.t), a_call)]
    parts.append(sensor.flush())
    spent = time.process_time() - started
    t, x, y, p = (np.concatenate([getattr(e, name) for e in parts]) for name in "txyp")
    return EventStream(t, x, y, p, width, height), spent


def crossings() -> dict[str, tuple[Make, bool]]:
    """Lists every crossing method of the sensor, and whether it takes dL/dt."""
    return {f"evis, {name}": (evis(crossing=name), name == "hermite") for name in CROSSINGS}


def run_esim(core: EsimCore, frames: Recording) -> tuple[EventStream, float]:
    """Runs ESIM's core on a recording: its events, and CPU seconds."""
    started = time.process_time()
    core.begin(C)
    for image, t in zip(frames.luminance, frames.t.tolist()):
        core.frame(image, t)
    spent = time.process_time() - started
    return core.end(), spent


def section(title: str, rows: list[dict[str, Any]], note: str) -> dict[str, Any]:
    """Makes a section of a report of these rows, CPU times rounded to milliseconds."""
    for row in rows:
        if isinstance(row.get("CPU [s]"), float):
            row["CPU [s]"] = round(row["CPU [s]"], 3)
    return {"title": title, "command": COMMAND, "rows": rows, "note": note}
