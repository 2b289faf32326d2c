"""Measures the time of one keyframe gap on a GPU and of its kernels, for `rigid` and `splat`, one environment and many.

    python -m bench.interpolation.gpu [--quick] [--json] [--device cuda]

640x480, K = 8, 30 Hz keyframes, output on the device. A gap is from the call to the end of the device's work, the least
of several gaps; `host` is how long the call itself took. Parts: kernels of one gap by name, from the device's own
clock, launched one by one. Then whole steps of evis.Simulation, one after the other, with frames alone and with samples
of single pixels between them.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

import evis
from bench import command
from bench.interpolation.cases import states_of
from evis.scene import load_scene
from evis.scene.model import Scene
from nodes.interpolator.keyframe import KeyframeView, Method, States
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.rigid import Rigid
from nodes.interpolator.splat.splat import make_splat
from nodes.renderer.renderer import Renderer

HEIGHT, WIDTH, RATE, UPSAMPLING = 480, 640, 30, 8
GAP = round(1e9 / RATE)
COMMAND = "python -m bench.interpolation.gpu"
START = 1_000_000_000
BETWEEN: dict[str, dict[str, Any]] = {
    "8 frames": {"time_tolerance": 0, "upsampling": 8},
    "32 frames": {"time_tolerance": 0, "upsampling": 32},
    **{f"{1e3 * t:g} ms": {"time_tolerance": t} for t in (8e-4, 3e-4, 1e-4)},
}
STEPPED = ("spinning_disk", "drone", "warehouse", "fidget_spinner")
WARM_STEPS = 4
"""Steps before anything is measured: kernels are loaded, graphs recorded, lists grown."""
STEP = 1_000_000
"""Sub-step of the states [ns]."""


def states_at(scene: Scene, last: int, envs: int) -> States:
    """Computes the bodies' states in the interval that ends at `last` ns; all environments are alike."""
    first = last - GAP
    inner = np.arange(first // STEP + 1, -(-last // STEP)) * STEP
    t = np.concatenate([[first], inner, [last]])
    one = states_of(scene, t)
    return States(t, np.repeat(one.pose, envs, 0), np.repeat(one.twist, envs, 0))


def keyframes(scene: Scene, envs: int, device: str, count: int) -> list[KeyframeView]:
    """Renders consecutive keyframes of a scene, on the device."""
    renderer, views = Renderer(scene, scene.cameras[0], envs, 0, device), []
    for k in range(count):
        stamp = START + k * GAP
        states = states_at(scene, stamp, envs)
        given = states.pose[:, -1], states.pose[:, 0], ("radiance", "depth", "motion")
        images = {n: np.array(a) for n, a in renderer.render(*given, t_ns=stamp).items()}
        arrays: list[wp.array] = [wp.array(images[n], dtype=wp.float32, device=device) for n in ("depth", "motion")]
        views.append(KeyframeView(luminance_of(images["radiance"], device), arrays[0], arrays[1], states, stamp))
    return views


def gap_ms(method: Method, views: list[KeyframeView], out: wp.array, held: list[bool]) -> tuple[float, float]:
    """Measures (whole, host) ms of the fastest gap in the second half, when kernels are loaded and recorded."""
    times = []
    for a, b in pairwise(views):
        wp.synchronize()
        start = time.perf_counter()
        method.between(a, b, held, out)
        host = time.perf_counter() - start
        wp.synchronize()
        times.append((1e3 * (time.perf_counter() - start), 1e3 * host))
    return min(times[len(times) // 2 :])


def kernel_ms(work: Callable[[], Any]) -> dict[str, float]:
    """Measures the device time of the ten longest kernels [ms]."""
    with wp.ScopedTimer("kernels", print=False, cuda_filter=wp.TIMING_ALL, synchronize=True) as timer:
        work()
    total: dict[str, float] = {}
    for result in timer.timing_results:
        name = result.name.split("(")[0].replace("forward kernel ", "").replace("__locals__", ".")
        total[name] = total.get(name, 0.0) + result.elapsed
    return {name: round(ms, 4) for name, ms in sorted(total.items(), key=lambda item: -item[1])[:10]}


def rows(name: str, envs: int, device: str, count: int, parts: bool) -> list[dict[str, Any]]:
    """Measures a scene, one row per method."""
    scene = load_scene(name, {"width": WIDTH, "height": HEIGHT})
    views = keyframes(scene, envs, device, count)
    out = wp.empty((envs, UPSAMPLING, HEIGHT, WIDTH), dtype=wp.float32, device=device)
    held, result = [False] * envs, []
    makers: dict[str, Callable[[], Method]] = {
        "rigid": lambda: Rigid(scene, scene.cameras[0], envs, UPSAMPLING, 0, 1, device),
        "splat": lambda: make_splat(HEIGHT, WIDTH, envs, UPSAMPLING, 0, 1, device),
    }
    for label, make in makers.items():
        method = make()
        whole, host = gap_ms(method, views, out, held)
        row: dict[str, Any] = {"scene": name, "method": label, "envs": envs, "ms": round(whole, 3)}
        row |= {"host ms": round(host, 3), "ms per env": round(whole / envs, 4)}
        if parts:
            fresh = make()
            fresh.between(views[0], views[1], held, out)
            # What happens for the first time is not recorded as a graph, whose kernels cannot be told apart.
            row["kernels ms"] = kernel_ms(partial(fresh.between, views[1], views[2], held, out))
        result.append(row)
    return result


def step_row(scene: str, device: str, count: int) -> dict[str, Any]:
    """Measures steps, from keyframe to keyframe, with frames alone and with samples between frames: median [ms]."""
    row: dict[str, Any] = {"scene": scene}
    for label, given in BETWEEN.items():
        with evis.Simulation(
            scene, outputs=["events"], device=device, width=WIDTH, height=HEIGHT, keyframe_rate=RATE, audit=0, **given
        ) as sim:
            sim.reset(seed=0)
            for _ in range(WARM_STEPS):
                sim.step()
            times = []
            for _ in range(count):
                began = time.perf_counter()
                sim.step()
                times.append(time.perf_counter() - began)
        row[f"{label} [ms]"] = round(1e3 * statistics.median(times), 1)
    return row


def measure(quick: bool = False, device: str = "cuda") -> dict[str, Any]:
    """Measures gaps of one environment and of many, and steps; quick: fewer gaps, and no 64 warehouses."""
    count, many = (12, 64) if quick else (24, 64)
    table: list[dict[str, Any]] = []
    for name in ("spinning_disk", "drone", "warehouse"):
        single = rows(name, 1, device, count, True)
        table += single
        if name == "warehouse" and quick:
            continue
        for row, one in zip(rows(name, many, device, 6, False), single):
            row["ratio"] = round(row["ms"] / (many * one["ms"]), 3)
            table.append(row)
    note = "ms: a whole gap, the least of several. host ms: until the call returns. ratio: the time of many "
    note += "environments over as many times that of one. kernels ms: of one gap, launched one by one."
    title = f"Gaps of 8 frames on {wp.get_device(device).name}, {WIDTH}x{HEIGHT}"
    steps = [step_row(name, device, 6 if quick else 20) for name in STEPPED[: 1 if quick else None]]
    return {
        "gaps": {"title": title, "command": COMMAND, "rows": table, "note": note},
        "steps": {
            "title": f"A step of evis.Simulation on {wp.get_device(device).name}, {WIDTH}x{HEIGHT}, events alone",
            "command": COMMAND,
            "rows": steps,
            "note": "Medians. Frames alone by their number per keyframe, samples between them by their time_tolerance.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="cuda")
