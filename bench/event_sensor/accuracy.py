"""Measures time errors, missed and extra events of the sensor on signals whose events are known, and on hard edges."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.event_sensor import disk
from bench.event_sensor.alignment import align
from bench.event_sensor.peers import QUOTED, SINUSOIDS, esim_core
from bench.event_sensor.sensing import MODELS, C, crossings, model, run_esim, section, sense
from bench.event_sensor.signals import FORMS, Recording, Sinusoids, stamps
from evis.events.measure.distance import EventStream

RATES = (125, 250, 1000)


def sinusoids(quick: bool) -> dict[str, Any]:
    """Measures time error, missed and extra events and run time on sinusoids, a section per frame rate."""
    signal = Sinusoids(60, 80) if quick else Sinusoids(240, 320)
    methods = crossings() | {f"{name} (our own code)": (model(name, **p), False) for name, p in MODELS.items()}
    sections = {}
    for rate in RATES:
        frames = signal.record(rate, 0.5)
        truth = signal.events(C, int(frames.t[-1]))
        rows: list[dict[str, Any]] = []
        for name, (make, slopes) in methods.items():
            events, spent = sense(make, frames, slopes)
            rows.append({"method": name, "source": "this run"} | align(events, truth).figures() | {"CPU [s]": spent})
        rows.append(_esim_sinusoids(frames, truth))
        for name, *figures in SINUSOIDS[rate]:
            # Their run time is that of the full size.
            columns = ("median [us]", "p99 [us]", "missed [%]", "extra [%]", *(() if quick else ("CPU [s]",)))
            rows.append({"method": name, "source": QUOTED} | dict(zip(columns, figures)))
        sections[f"sinusoid_{rate}"] = section(
            f"Sinusoids at {rate} Hz frames, against closed form",
            [row for row in rows if len(row) > 2],
            f"{signal.shape[1]} x {signal.shape[0]} pixels, L = ln 71 + A sin(2 pi f t + phi), A 0.25 to 1.25, "
            f"f 1 to 20 Hz log-uniform, 0.5 s, C {C}: {len(truth.t)} events. Pairs by an order-preserving alignment "
            "per pixel and polarity with 4 ms per unpaired event. evis, hermite is given dL/dt. quoted: the "
            "authors' own programs on another machine.",
        )
    return sections


def _esim_sinusoids(frames: Recording, truth: EventStream) -> dict[str, Any]:
    core = esim_core()
    if core is None:
        return {}
    events, spent = run_esim(core, frames)
    return {"method": "esim_py core", "source": "this run"} | align(events, truth).figures() | {"CPU [s]": spent}


def closed_forms(quick: bool) -> dict[str, Any]:
    """Measures the largest time error of each method on a ramp, a step and an exponential."""
    rows = []
    for form in FORMS:
        for rate in (125, 1000):
            frames = form.record(rate, 0.4)
            truth = form.events(C, int(frames.t[-1]))
            row: dict[str, Any] = {"signal": form.name, "frames [Hz]": rate, "true events": len(truth.t)}
            for name, (make, slopes) in crossings().items():
                events, _ = sense(make, frames, slopes)
                # Monotone signals: the k-th event is the k-th crossing.
                most = np.abs(events.t - truth.t).max() / 1e3 if len(events.t) == len(truth.t) else None
                short = name.removeprefix("evis, ")
                row[f"{short} [us]"] = f"{len(events.t)} events" if most is None else float(f"{most:.3g}")
            rows.append(row)
    note = "Largest time error; the number of events instead where it is not the true one. A step between two frames "
    note += "has no time of its own: linear spreads its events over the frame, so up to one frame is the right answer."
    return {"closed_forms": section("Ramp, step and exponential, one pixel", rows, note)}


def edges(quick: bool) -> dict[str, Any]:
    """Measures every method on hard edges: the disk at lower frame rates against its own dense rendering.

    The reference spreads an edge over its own step, so the highest rates have one of 64 kHz, of the picture's middle.
    """
    size = (320, 260) if quick else (640, 480)
    sections: dict[str, Any] = {}
    for soft, rates, dense, milliseconds, shape in (
        (1.0, (250, 1000) if quick else (125, 250, 500, 1000, 2000), 16_000, 24, size),
        (0.0, (250, 1000) if quick else (125, 250, 500, 1000, 2000), 16_000, 24, size),
        (1.0, (4000,) if quick else (4000, 8000), 64_000, 8, (160, 130)),
        (0.0, (4000,) if quick else (4000, 8000), 64_000, 8, (160, 130)),
    ):
        t = stamps(dense, milliseconds * 1e-3)
        everything = disk.record(t, soft, *shape)
        truth = disk.reference_events(everything.luminance, t, C)
        rows = []
        for rate in rates:
            part = Recording(
                *(np.ascontiguousarray(a[:: dense // rate]) for a in (everything.luminance, everything.dlog_dt, t))
            )
            for method, (make, slopes) in crossings().items():
                events, _ = sense(make, part, slopes)
                rows.append({"frames [Hz]": rate, "method": method} | align(events, truth).figures())
        how = "edges one pixel wide (box filter)" if soft else "edges without width (point samples)"
        name = ("edges" if soft else "point_samples") + ("_fine" if dense == 64_000 else "")
        sections[name] = section(
            f"Hard edges: the disk against its own rendering at {dense} Hz, {how}",
            rows,
            f"{shape[0]} x {shape[1]}, {milliseconds} ms, {len(truth.t)} events in the reference (linear, float64). "
            "hermite is given dL/dt of the picture, which is 0 inside a patch.",
        )
    return sections
