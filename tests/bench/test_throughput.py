"""Whole runs on one device: what is measured of them, and what their kernels are held against."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import evis
from bench import gpu_graph
from bench.event_sensor.gpu_peers import peers
from bench.roofline import kernels as roofline
from bench.roofline.ceilings import Ceilings
from bench.roofline.counted_source import HIDDEN, ONE, READ, counted, kind_of
from bench.roofline.launches import symbol_of
from bench.throughput import errors
from bench.throughput.attempts import Limits, NotRun, attempt
from bench.throughput.cases import CASES, Case, chosen
from bench.throughput.recording import by_name, union
from bench.throughput.sensors import of_ours
from bench.throughput.tables import frames_row
from evis.events.measure.distance import victor_purpura

TINY = Case("spinning_disk", 30, 8, size=(32, 24))
COUNTED = """
import json, os, sys
import warp as wp
from bench.roofline.counting import Counting
counting = Counting(wp.get_device(sys.argv[2]))
counting.on = True
sys.path.insert(0, sys.argv[1])
import counted_by_hand
print(json.dumps(counting.kernels))
"""
BY_HAND = """
import sys
import warp as wp

@wp.struct
class Held:
    points: wp.array(dtype=wp.vec3)
    k: int

@wp.func_native("return values.data[at];")
def read(values: wp.array(dtype=float), at: int) -> float: ...

@wp.func
def term(x: wp.vec3, y: float):
    return wp.dot(x, x) * y + wp.sqrt(y)

@wp.kernel
def add_up(n: int, a: float, x: wp.array(dtype=float), held: Held, y: wp.array2d(dtype=float), c: wp.array(dtype=int)):
    i = wp.tid()
    if x[i] < 0.5:
        return
    total = float(0.0)
    for j in range(n):
        total += a * read(x, i) + term(held.points[i], total)
    turned = wp.identity(n=3, dtype=float) * held.points[i]
    y[i, 0] = total + turned[0]
    wp.atomic_add(c, 0, 1)

device = sys.argv[2]
x = wp.array([0.0] * 3 + [1.0] * 7, dtype=float, device=device)
held = Held()
held.points = wp.zeros(10, dtype=wp.vec3, device=device)
outputs = [wp.zeros((10, 2), dtype=float, device=device), wp.zeros(1, dtype=int, device=device)]
command = wp.launch(add_up, dim=10, inputs=[4, 2.0, x, held, *outputs], device=device, record_cmd=True)
command.launch()
command.launch()
"""


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def by_hand(request, tmp_path_factory):
    """The counts of a kernel, in a process of its own: Warp's code is changed there."""
    folder = tmp_path_factory.mktemp("counted")
    (folder / "counted_by_hand.py").write_text(BY_HAND)
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", COUNTED, str(folder), request.param], capture_output=True, text=True, check=True,
        env=os.environ | {"WARP_CACHE_PATH": str(folder), "PYTHONPATH": path},
    )  # fmt: skip
    return json.loads(done.stdout.strip().splitlines()[-1])


def test_bytes_and_operations_are_those_counted_by_hand(by_hand):
    """Of 10 threads 3 read one number and leave; the others go round a loop 4 times."""
    (kernel,) = by_hand.values()
    in_loop = 4 + 12, 1 + 1 + (5 + 1 + 1 + 1) + 1  # a number and a point; a * x, +, term, total +
    leaving = 4, 1
    staying = 4 + 4 * in_loop[0] + 12 + 4 + 2 * 4, 1 + 4 * in_loop[1] + 3 * 5 + 1 + 1
    assert kernel["name"] == "add_up" and kernel["calls"] == 2 and kernel["native"] == 0
    assert kernel["bytes"] == 2 * (3 * leaving[0] + 7 * staying[0])
    assert kernel["operations"] == 2 * (3 * leaving[1] + 7 * staying[1])


def test_functions_in_cpp_that_do_more_than_one_thing_are_told():
    assert kind_of("return values.data[at];", True) == READ and kind_of("return a * b;", False) == ONE
    assert kind_of("for (int i = 0; i < n; ++i) sum += x[i];", True) == HIDDEN


def test_only_the_part_of_a_function_in_cpp_that_runs_tells_what_it_does():
    body = (
        "#if defined(__CUDA_ARCH__)\n    return __ffs(mask) - 1;\n#else\n    while (mask) ++n;\n    return n;\n#endif\n"
    )
    assert kind_of(body, False, on_gpu=True) == ONE and kind_of(body, False, on_gpu=False) == HIDDEN


def test_counters_are_put_before_the_control_goes_elsewhere():
    """A branch that is not taken costs nothing: its counters stand within it."""
    lines = ["#define builtin_tid1d() 0", "static float f(", "    // forward", "    if (var_1) {",
             "        var_3 = wp::mul(var_1, var_2);", "        return var_3;", "    }",
             "    var_4 = wp::add(var_1, var_2);", "    return var_4;"]  # fmt: skip
    body = counted("\n".join(lines), 0, {}).split("static float f(")[1].splitlines()
    added = [i for i, line in enumerate(body) if "EVIS_ADD(1" in line]
    assert [body[i + 1].strip() for i in added] == ["return var_3;", "return var_4;"]
    assert "EVIS_PRODUCT(var_1, var_2)" in body[added[0]] and "EVIS_NUMBERS(var_1)" in body[added[1]]


def test_time_in_which_anything_is_done():
    """Spans that overlap count once, gaps between them do not count."""
    assert union([(0, 10), (5, 10), (20, 5), (21, 1), (25, 5)]) == 15 + 10 and union([]) == 0
    assert list(by_name([("a", 0, 10**9), ("b", 0, 3 * 10**9), ("a", 5, 10**9)]).items()) == [
        ("b", [1, 3.0]),
        ("a", [2, 2.0]),
    ]


def test_names_that_a_profiler_tells_are_those_of_kernels():
    assert (
        symbol_of("make_gather__locals__gather_6436c9f7_cuda_kernel_forward") == "make_gather__locals__gather_6436c9f7"
    )
    assert (
        symbol_of("void cub::sort<(int)3, long>(long*)") == "cub::sort"
        and symbol_of("Memcpy DtoD (Device)") == "Memcpy DtoD"
    )


def test_a_kernel_is_held_against_what_limits_it():
    """One that copies at the caches' rate, one that computes at half of the rate, one that waits, one not counted."""
    ceilings = Ceilings(memory=1e9, cache=2e9, operations=1e12)
    timed = {
        "copy_1": (1.0, 1.0),
        "sums_1": (2.0, 2.0),
        "walk_1": (1.0, 1.0),
        "hide_1": (1.0, 0.9),
        "Memcpy": (1.0, 0.5),
        "brief": (1.0, 0.001),
    }
    one = {"calls": 2, "native": 0}
    counts = {
        "copy_1": {"name": "copy", "bytes": 4e6, "operations": 0, **one},
        "sums_1": {"name": "make.<locals>.sums", "bytes": 2e3, "operations": 1e9, **one},
        "walk_1": {"name": "walk", "bytes": 4e3, "operations": 4e3, "calls": 2, "native": 30},
        "hide_1": {"name": "hide", "bytes": 4e3, "operations": 4e3, "calls": 2, "native": 50},
    }
    found = {row["kernel"]: row for row in roofline.rows("run", roofline.kernels_of(timed, counts), ceilings)}
    assert list(found) == ["sums", "copy", "walk", "hide", "Memcpy"]
    assert (found["copy"]["limit"], found["copy"]["of the roof"], found["copy"]["of the memory's"]) == (
        "bytes",
        "100 %",
        "200 %",
    )
    assert (found["sums"]["limit"], found["sums"]["of the roof"], found["sums"]["Gop/s"]) == (
        "operations",
        "50 %",
        500.0,
    )
    assert found["walk"]["limit"] == "neither" and "limit" not in found["Memcpy"]
    assert found["hide"]["limit"] == "native code, not counted"


def test_rows_are_chosen_by_words():
    assert [case.name for case in chosen(CASES, ("8 x 60x4", "disk 1000"), True)] == [
        "disk 1000x1",
        "warehouse 8 x 60x4",
    ]
    assert len(chosen(CASES, (), True)) < len(chosen(CASES, (), False)) == len(CASES)
    assert len({case.name for case in CASES}) == len(CASES)


def test_a_run_is_measured(monkeypatch):
    """Its windows, what its kernels take, its memory and its first event are in its row; others have none."""
    monkeypatch.setattr("bench.throughput.sections.CASES", (TINY,))
    made = gpu_graph.measure(True, "cpu", rows=("disk",), sections=("frames",), timeout=600)
    (row,) = made["frames"]["rows"]
    assert row["run"] == "disk 30x8 32x24" and row["unit"] == "RTF" and row["not measured"] is None
    assert 0 < row["min"] <= row["median"] <= row["max"] and row["windows"] == 5
    assert row["host [ms a gap]"] == row["gap [ms]"] > row["device [ms a gap]"] > 0
    assert row["first event [s]"] > 0 and row["memory [MB]"] > 50
    assert sum(kernel["ms a gap"] for kernel in made["kernels"]["rows"]) < row["gap [ms]"]
    every = ("frames", "defaults", "starts", "roofline")
    assert gpu_graph.measure(True, "cpu", rows=("none such",), sections=every) == {}


@pytest.mark.slow
def test_kernels_of_gaps_in_a_batch_are_counted(tmp_path):
    """Keyframes come four at a time, so that none may be the one at which counting was to begin or end."""
    limits = Limits(120.0, time.monotonic() + 120)
    there = {"WARP_CACHE_PATH": str(tmp_path)}
    run = attempt(TINY, "cpu", {"audit": 0, "batch": 4}, limits, meter={"counts": True}, environment=there)
    found = {roofline.short(kernel["name"]): kernel for kernel in run["meter"]["counted"].values()}
    assert found["gather"]["calls"] >= 2 and found["gather"]["bytes"] > 0


def test_a_run_that_does_not_fit_says_why():
    """No time is left, it takes too long, it needs more memory than there is, its scene cannot be loaded."""
    now = time.monotonic()
    for case, limits, why in (
        (TINY, Limits(60.0, now), "no time was left"),
        (TINY, Limits(0.05, now + 60), "took longer than 0 s"),
        (Case("spinning_disk", 30, 8, needs_gb=1e6), Limits(60.0, now + 60), "needs 1e+06 GB, and "),
        (Case("no_such_scene", 30, 8), Limits(60.0, now + 60), "failed: "),
    ):
        with pytest.raises(NotRun, match=why.replace("+", r"\+")):
            attempt(case, "cpu", {}, limits)
    assert frames_row(TINY, "cpu", Limits(60.0, now))["not measured"] == "no time was left"


def test_a_sensor_that_cannot_be_run_says_why(monkeypatch, tmp_path):
    """Without checkouts, and with a folder that has none; ours is measured whatever there is."""
    monkeypatch.delenv("EVIS_PEERS", raising=False)
    told = dict(peers("cpu"))
    assert len(told) == 2 and set(told.values()) == {"EVIS_PEERS names no folder with a checkout"}
    monkeypatch.setenv("EVIS_PEERS", str(tmp_path))
    assert all(f"in EVIS_PEERS={tmp_path}" in why for why in dict(peers("cpu")).values())
    frames = np.exp(np.random.default_rng(0).normal(size=(4, 12, 16))).astype(np.float32)
    assert of_ours(frames, 2, 1, "cpu") > 0


def test_rows_of_an_earlier_part_are_kept():
    """A run that is measured again counts anew, and one that had no figures now keeps those it had."""
    earlier = {"frames": {"title": "T", "rows": [{"run": "a", "median": 1}, {"run": "b", "median": 2}]}, "starts": {}}
    rows = [{"run": "b", "not measured": "no time was left"}, {"run": "a", "median": 3}]
    made = gpu_graph.with_rows_of({"frames": {"title": "T", "rows": rows}}, earlier)
    assert made["frames"]["rows"] == [{"run": "b", "median": 2}, {"run": "a", "median": 3}] and "starts" in made
    with pytest.raises(ValueError, match="the earlier report is of 'T', this one of 'U'"):
        gpu_graph.with_rows_of({"frames": {"title": "U", "rows": rows}}, earlier)


def test_errors_are_those_of_the_events_at_some_pixels(monkeypatch):
    """Dense rendering at twice the rate has less error, and at the truth's own rate none; all is of one pixel in 16."""
    size = (48, 36)
    of = lambda rate: errors.stream(Case("spinning_disk", rate, 1, size=size), "cpu")
    truth = of(3840)
    assert (truth.width, truth.height) == (12, 9) and truth.x.max() < 12 and truth.y.max() < 9
    assert np.all(np.diff(truth.t) >= 0) and 100_000_000 > truth.t[-1] - truth.t[0] > 90_000_000
    with evis.Simulation("spinning_disk", width=48, height=36, keyframe_rate=3840, upsampling=1) as simulation:
        steps = simulation.run(errors.GAPS / errors.RATE)
    counted = sum(int(((step.events.x % 4 == 0) & (step.events.y % 4 == 0)).sum()) for step in steps if step.events)
    assert len(truth.t) == counted > 100
    assert victor_purpura(of(3840), truth, 1.0) == 0.0
    monkeypatch.setattr(errors, "attempt", lambda *given, **more: {"meter": {"windows": [{"rtf": 2.0}]}})
    rows = [
        errors.row(errors.DENSE, Case("spinning_disk", rate, 1, size=size), truth, "cpu", Limits(60.0, 0.0))
        for rate in (240, 480)
    ]
    assert rows[0]["error"] > rows[1]["error"] > 0.0 and rows[0]["samples"] == "240 Hz dense"
    assert rows[0]["run time [ms]"] == pytest.approx(1e3 / 60, abs=1e-3)


def test_errors_against_run_time_are_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    rows = [
        {"scene": "drone", "samples": f"{rate} Hz dense", "error": error, "run time [ms]": ms}
        for rate, error, ms in ((240, 0.3, 2.0), (960, 0.1, 9.0), (3840, 0.02, None))
    ]
    (path,) = gpu_graph.plot({"errors": {"rows": rows}}, tmp_path)
    assert path.name == "errors.png" and path.stat().st_size > 10_000


def test_the_roofline_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    rows = [
        {"run": "disk", "kernel": "gather", "us a gap": 5.0, "op/byte": 0.5, "Gop/s": 3.0},
        {"run": "disk", "kernel": "x"},
    ]
    rates = [{"what": what, "rate": rate} for what, rate in (("memory", 10.0), ("caches", 40.0), ("float32", 30.0))]
    sections = {"ceilings": {"rows": rates}, "roofline": {"title": "T", "rows": rows}}
    (path,) = gpu_graph.plot(sections, tmp_path)
    assert path.stat().st_size > 10_000
