"""Time of one keyframe gap on a GPU, and where it goes: `rigid` and `splat`, one environment and many.

    python -m bench.interpolation_gpu [--quick] [--json] [--device cuda]

640x480, K = 8, 30 Hz keyframes, output on the device. A gap is from the call to the end of the device's work, the least
of several gaps; `host` is how long the call itself took. Parts: kernels of one gap by name, from the device's own
clock, launched one by one.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.scene import load_scene
from nodes.interpolator.keyframe import KeyframeView, Method, States
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.rigid import Rigid
from nodes.interpolator.splat.splat import make_splat
from nodes.renderer.renderer import Renderer

HEIGHT, WIDTH, RATE, UPSAMPLING = 480, 640, 30, 8
GAP = round(1e9 / RATE)
START = 1_000_000_000
STEP = 1_000_000
"""Sub-step of the states [ns]."""


def states_at(scene: Any, last: int, envs: int) -> States:
    """Of the bodies in the interval that ends at `last` ns; all environments are alike."""
    first = last - GAP
    inner = np.arange(first // STEP + 1, -(-last // STEP)) * STEP
    t = np.concatenate([[first], inner, [last]])
    pose, twist = (np.stack([getattr(b.trajectory, n)(t) for b in scene.bodies], 1)[None] for n in ("pose", "twist"))
    return States(t, np.repeat(pose, envs, 0), np.repeat(twist, envs, 0))


def keyframes(scene: Any, envs: int, device: str, count: int) -> list[KeyframeView]:
    """Consecutive keyframes of a scene, on the device."""
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
    """(whole, host) ms of the fastest gap, but for the first half of them, which load kernels and record graphs."""
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
    """Device time by kernel, the ten longest."""
    with wp.ScopedTimer("kernels", print=False, cuda_filter=wp.TIMING_ALL, synchronize=True) as timer:
        work()
    total: dict[str, float] = {}
    for result in timer.timing_results:
        name = result.name.split("(")[0].replace("forward kernel ", "").replace("__locals__", ".")
        total[name] = total.get(name, 0.0) + result.elapsed
    return {name: round(ms, 4) for name, ms in sorted(total.items(), key=lambda item: -item[1])[:10]}


def rows(name: str, envs: int, device: str, count: int, parts: bool) -> list[dict[str, Any]]:
    """One row per method for a scene."""
    scene = load_scene(name, {"width": WIDTH, "height": HEIGHT})
    views = keyframes(scene, envs, device, count)
    out = wp.empty((envs, UPSAMPLING, HEIGHT, WIDTH), dtype=wp.float32, device=device)
    held, result = [False] * envs, []
    makers: dict[str, Callable[[], Any]] = {
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


def measure(quick: bool = False, device: str = "cuda", parts: bool = True) -> list[dict[str, Any]]:
    """All rows; with `ratio`, the time of many environments over as many times one."""
    count, many = (12, 64) if quick else (24, 64)
    table: list[dict[str, Any]] = []
    for name in ("spinning_disk", "drone", "warehouse"):
        single = rows(name, 1, device, count, parts)
        table += single
        if name == "warehouse" and quick:
            continue
        for row, one in zip(rows(name, many, device, 6, False), single):
            row["ratio"] = round(row["ms"] / (many * one["ms"]), 3)
            table.append(row)
    return table


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer gaps, and no 64 warehouses")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--device", default="cuda", help="cuda or cuda:N")
    args = parser.parse_args()
    if not wp.is_cuda_available():
        parser.exit(1, "this measures a GPU and there is none here; bench.interpolation_speed measures a CPU\n")
    table = measure(args.quick, args.device)
    if args.json:
        print(json.dumps(table, indent=1))
        return
    for row in table:
        print("  ".join(f"{k}: {v}" for k, v in row.items()), flush=True)


if __name__ == "__main__":
    main()
