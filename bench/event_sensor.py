"""The event sensor against closed forms, against other simulators on the same frames, and what each fault costs.

`python -m bench.event_sensor [--quick]`. `EVIS_PEERS=DIR` with a checkout of rpg_vid2e in DIR runs ESIM's own core
beside it (bench/peers.py). CPU seconds are process time of one core; frames are in memory, compilation is done before.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench import disk
from bench.alignment import align
from bench.peers import DISK, QUOTED, SINUSOIDS, esim_core
from bench.signals import FORMS, Recording, Sinusoids, stamps
from evis.events.measure.distance import EventStream
from nodes.event_sensor.parameters import CROSSINGS
from nodes.event_sensor.peers import make_model
from nodes.event_sensor.peers.v2e import NOISY
from nodes.event_sensor.sensor import EventSensor

COMMAND = "evis bench event_sensor"
C = 0.2
RATES = (125, 250, 1000)
FRAMES_A_CALL = 8
QUIET_VOLTMETER = {"k2": 0.0, "k3": 1e-6, "k4": 0.0, "k5": 0.0, "k6": 1e-6}
"""DVS-Voltmeter with hardly any noise and no dark level."""
MODELS: dict[str, dict[str, Any]] = {"esim": {}, "v2e": {}, "dvs_voltmeter": QUIET_VOLTMETER}
FAULTS: dict[str, dict[str, Any]] = {
    "threshold mismatch": {"threshold_mismatch": 0.05},
    "refractory period": {"refractory_us": 100.0},
    "leak": {"leak_rate": 0.1, "leak_jitter": 0.1},
    "shot noise": {"shot_rate": 5.0, "shot_white": 100.0},
    "hot pixels": {"hot_pixel_fraction": 0.001, "hot_pixel_rate": 100.0},
    "defocus": {"defocus_px": 0.5},
}
"""The faults of the paper, at about the strength of v2e's preset "noisy"."""
BEYOND: dict[str, dict[str, Any]] = {
    "photoreceptor bandwidth": {"bandwidth_hz": 300.0, "bandwidth_level": 100.0},
    "readout jitter": {"timestamp_jitter_us": 5.0},
}
"""Faults that the paper's model does not have."""
ALL: dict[str, Any] = {name: value for fault in FAULTS.values() for name, value in fault.items()}

Make = Callable[[int, int], Any]


def evis(**params: Any) -> Make:
    """The sensor of this project with these parameters."""
    return lambda height, width: EventSensor(height, width, **{"threshold": C, **params})


def model(name: str, **params: Any) -> Make:
    """Another model with these parameters."""
    return lambda height, width: make_model(name, height, width, **{"threshold": C, **params})


def sense(
    make: Make, frames: Recording, slopes: bool = False, a_call: int = FRAMES_A_CALL
) -> tuple[EventStream, float]:
    """Events and CPU seconds of a recording, one call for every `a_call` frames after the first."""
    _, height, width = frames.luminance.shape
    episodes = np.zeros(1, np.int32)

    def feed(sensor: Any, part: slice) -> Any:
        images, t = frames.luminance[None, part], frames.t[part]
        more = {"dlog_dt": frames.dlog_dt[None, part]} if slopes else {}
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
    """Every method of the sensor, and whether it takes dL/dt."""
    return {f"evis, {name}": (evis(crossing=name), name == "hermite") for name in CROSSINGS}


def sinusoids(quick: bool) -> dict[str, Any]:
    """One section per frame rate: time error, missed and extra events, run time, against the closed form."""
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
        sections[f"sinusoid_{rate}"] = _section(
            f"Sinusoids at {rate} Hz frames, against closed form",
            [row for row in rows if len(row) > 2],
            f"{signal.shape[1]} x {signal.shape[0]} pixels, L = ln 71 + A sin(2 pi f t + phi), A 0.25 to 1.25, "
            f"f 1 to 20 Hz log-uniform, 0.5 s, C {C}: {len(truth.t)} events. Pairs by an order-preserving alignment "
            "per pixel and polarity with 4 ms per unpaired event. evis, hermite is given dL/dt.",
        )
    return sections


def _esim_sinusoids(frames: Recording, truth: EventStream) -> dict[str, Any]:
    core = esim_core()
    if core is None:
        return {}
    events, spent = _run_esim(core, frames)
    return {"method": "esim_py core", "source": "this run"} | align(events, truth).figures() | {"CPU [s]": spent}


def _run_esim(core: Any, frames: Recording) -> tuple[EventStream, float]:
    started = time.process_time()
    core.begin(C)
    for image, t in zip(frames.luminance, frames.t.tolist()):
        core.frame(image, t)
    spent = time.process_time() - started
    return core.end(), spent


def closed_forms(quick: bool) -> dict[str, Any]:
    """Ramp, step and exponential: the number of events and the largest time error of each method."""
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
    return {"closed_forms": _section("Ramp, step and exponential, one pixel", rows, note)}


def speed(quick: bool) -> dict[str, Any]:
    """Frames per CPU second on the disk, and the number of events, beside other simulators."""
    t = stamps(1000, 0.039 if quick else 0.199)
    frames = disk.record(t, 1.0)
    truth = disk.reference_events(frames.luminance, t, C)
    repeats = 1 if quick else 3
    rows: list[dict[str, Any]] = []

    def add(name: str, make: Make, slopes: bool = False, a_call: int = FRAMES_A_CALL, plain: bool = True) -> None:
        runs = [sense(make, frames, slopes, a_call) for _ in range(repeats if name.startswith("evis") else 1)]
        rows.append(_speed_row(name, len(t), [spent for _, spent in runs], runs[0][0], truth if plain else None))

    for name, (make, slopes) in crossings().items():
        add(name, make, slopes)
    add("evis, linear, one frame a call", evis(), a_call=1)
    core = esim_core()
    if core is not None:
        runs = [_run_esim(core, frames) for _ in range(repeats)]
        rows.append(_speed_row("esim_py core", len(t), [spent for _, spent in runs], runs[0][0], truth))
    for name, params in MODELS.items():
        add(f"{name} (our own code)", model(name, **params))
    add("evis, the paper's six faults", evis(**ALL), plain=False)
    everything = ALL | {name: value for fault in BEYOND.values() for name, value in fault.items()}
    add("evis, those, photoreceptor and readout", evis(**everything), plain=False)
    add("v2e noisy preset (our own code)", model("v2e", **NOISY, shot_white=1000.0), plain=False)
    for name, rate, error in DISK:
        rows.append({"simulator": name, "source": QUOTED, "frames/s": rate, "events against truth [%]": error})
    base = next((r["frames/s"] for r in rows if r["simulator"] == "esim_py core" and r["source"] == "this run"), None)
    for row in rows:
        if base and row["source"] == "this run":
            row["x esim_py core"] = round(row["frames/s"] / base, 2)
    note = f"640 x 480 float32, {len(t)} frames at 1 kHz, {len(truth.t)} events in float64 with whole levels, "
    note += f"{len(truth.t) / len(t):.0f} a frame; up to 8 per pixel and frame. Median of {repeats}, "
    note += "of the other models one run. "
    note += "The quoted peers ran on frames of the same description with 4,419,506 events."
    return {"disk": _section("Speed on the high-dynamic-range disk, one core", rows, note)}


def _speed_row(
    name: str, frames: int, spent: list[float], events: EventStream, truth: EventStream | None
) -> dict[str, Any]:
    middle = float(np.median(spent))
    row: dict[str, Any] = {"simulator": name, "source": "this run", "frames/s": round(frames / middle, 1)}
    row |= {"CPU [s]": round(middle, 3), "events": len(events.t), "Mev/s": round(len(events.t) / middle / 1e6, 2)}
    if truth is not None:
        row["events against truth [%]"] = round(100 * (len(events.t) / len(truth.t) - 1), 4)
        pixels = [np.bincount(s.y.astype(int) * s.width + s.x, minlength=s.width * s.height) for s in (events, truth)]
        row["pixels that differ [%]"] = round(100 * float((pixels[0] != pixels[1]).mean()), 3)
    return row


def edges(quick: bool) -> dict[str, Any]:
    """Hard edges: the disk sampled at lower rates against its own dense rendering, every method.

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
        sections[name] = _section(
            f"Hard edges: the disk against its own rendering at {dense} Hz, {how}",
            rows,
            f"{shape[0]} x {shape[1]}, {milliseconds} ms, {len(truth.t)} events in the reference (linear, float64). "
            "hermite is given dL/dt of the picture, which is 0 inside a patch.",
        )
    return sections


def omissions(quick: bool) -> dict[str, Any]:
    """What each fault adds to a frame of the disk, one at a time and all together."""
    t = stamps(1000, 0.039 if quick else 0.099)
    frames = disk.record(t, 1.0)
    repeats = 1 if quick else 3
    cases: dict[str, dict[str, Any]] = {"none": {}, **FAULTS, **BEYOND, "the paper's six": ALL}
    cases |= {f"crossing {name}": {"crossing": name} for name in CROSSINGS}
    rows: list[dict[str, Any]] = []
    for name, params in cases.items():
        runs = [sense(evis(**params), frames, params.get("crossing") == "hermite") for _ in range(repeats)]
        ms = 1e3 * float(np.median([spent for _, spent in runs])) / len(t)
        rows.append({"with": name, "ms a frame": round(ms, 3), "events a frame": round(len(runs[0][0].t) / len(t))})
        rows[-1]["x none"] = round(ms / rows[0]["ms a frame"], 2)
    settings = "; ".join(f"{name}: {json.dumps(value)}" for name, value in {**FAULTS, **BEYOND}.items())
    note = f"640 x 480, {len(t)} frames at 1 kHz, {FRAMES_A_CALL} a call. What is not asked for is not compiled in. "
    return {"omissions": _section("What each fault costs", rows, note + settings)}


def _section(title: str, rows: list[dict[str, Any]], note: str) -> dict[str, Any]:
    for row in rows:
        if isinstance(row.get("CPU [s]"), float):
            row["CPU [s]"] = round(row["CPU [s]"], 3)
    return {"title": title, "command": COMMAND, "rows": rows, "note": note}


def measure(quick: bool = False) -> dict[str, Any]:
    """All tables; quick: fewer pixels, frames and repetitions."""
    sections: dict[str, Any] = {}
    for table in (sinusoids, closed_forms, speed, edges, omissions):
        sections |= table(quick)
    return sections


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Median time error of the sinusoids against run time, a line per method over the frame rates."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.8, 4.6), dpi=140)
    lines: dict[tuple[str, str], list[tuple[float, float, int]]] = {}
    for rate in RATES:
        for row in sections[f"sinusoid_{rate}"]["rows"]:
            if row.get("CPU [s]"):
                key = (row["method"], row["source"])
                lines.setdefault(key, []).append((row["CPU [s]"], row["median [us]"], rate))
    for (name, source), points in lines.items():
        ours = source != QUOTED
        label = name if ours else f"{name} (quoted)"
        axes.plot(*zip(*[p[:2] for p in points]), "o-" if ours else "x:", label=label, alpha=1.0 if ours else 0.5)
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds for 0.5 s, 125, 250 and 1000 Hz frames",
             ylabel="median time error [us]", title="Sinusoids against closed form")  # fmt: skip
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=6, ncol=2)
    figure.tight_layout()
    path = out / "event_sensor_sinusoids.png"
    figure.savefig(path)
    plt.close(figure)
    return [path]


if __name__ == "__main__":
    for section in measure("--quick" in sys.argv[1:]).values():
        print(section["title"])
        for row in section["rows"]:
            print(" ", json.dumps(row))
        print(" ", section["note"])
