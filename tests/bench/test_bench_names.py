"""No benchmark uses a name that is no more: all are imported, read by mypy, and those of a GPU run small on a CPU."""

from __future__ import annotations

import importlib
import pkgutil
import tomllib
from pathlib import Path

import pytest

import bench
from bench.event_sensor import gpu as sensor_gpu
from bench.interpolation import gpu as interpolation_gpu
from bench.renderer import gpu as renderer_gpu
from nodes.event_sensor.sensor import EventSensor

ROOT = Path(__file__).parents[2]
MODULES = sorted(found.name for found in pkgutil.walk_packages(bench.__path__, "bench."))


def test_there_are_modules_to_look_at():
    assert len(MODULES) > 40 and {"bench.report", "bench.renderer.stages", "bench.streams.peers"} <= set(MODULES)


@pytest.mark.parametrize("module", MODULES)
def test_a_module_is_imported(module):
    """What it imports exists."""
    assert importlib.import_module(module).__doc__


def test_mypy_reads_bench():
    """With types on every function: of an argument without one it checks no attribute."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    assert "bench" in settings["packages"] and settings["check_untyped_defs"]
    assert {"module": "bench.*", "disallow_untyped_defs": True} in settings["overrides"]


def test_the_gpu_sensor_benchmark_feeds_a_sensor():
    """Waited for and in flight it makes the same number of events; a later round makes as many as an earlier one."""
    images = sensor_gpu.sparse_frames(2, 3, 24, 32, "cpu")
    one, other = (sensor_gpu.Loop(EventSensor(24, 32, 2, device="cpu"), images) for _ in range(2))
    events = [one.run(4, 1), other.run(4, 2)]
    assert events[0] == events[1] > 0
    assert one.timed(4, 2)[1] == other.timed(4, 1)[1] > 0


@pytest.mark.slow
def test_the_gpu_interpolation_benchmark_measures_gaps(monkeypatch):
    """A row for each method, with the time of a gap."""
    monkeypatch.setattr(interpolation_gpu, "HEIGHT", 36)
    monkeypatch.setattr(interpolation_gpu, "WIDTH", 48)
    rows = interpolation_gpu.rows("spinning_disk", 2, "cpu", 4, True)
    assert [row["method"] for row in rows] == ["rigid", "splat"]
    assert all(row["ms"] >= row["host ms"] > 0 for row in rows)


def test_the_gpu_renderer_benchmark_draws(monkeypatch):
    """All that it measures is called; the device's own clock is that of a GPU alone."""

    def called(call, count, device):
        for i in range(count + 4):
            call(i)
        return {"calls": count + 4}

    monkeypatch.setattr(renderer_gpu, "timed", called)
    rows = list(renderer_gpu.rows_of("spinning_disk", 2, (48, 36), 2, "cpu"))
    assert [row["what"] for row in rows] == [
        "visibility",
        "poses checked and sent",
        "all outputs, shadows of 1 light",
        "all outputs, no shadows",
    ]
    assert all(row["calls"] == 6 for row in rows)
