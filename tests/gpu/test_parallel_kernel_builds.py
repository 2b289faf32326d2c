"""Kernels that are compiled side by side."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from evis.gpu.building import FEWEST_CORES, LAUNCH_BLOCK, _compile, begin_building, build_together


def kernel_of(factor: float) -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False)
    def scaled(values: wp.array(dtype=wp.float32)):
        i = wp.tid()
        values[i] = values[i] * wp.static(factor)

    return scaled


@pytest.fixture(autouse=True)
def _cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine where it pays. Warp runs: what a test sets of it is put back to what it is then."""
    wp.init()
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(FEWEST_CORES)))


def test_what_was_built_is_launched_without_compiling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    kernels = [kernel_of(1.0 + 0.5 * k) for k in range(3)]
    build_together("cpu", [(kernel, LAUNCH_BLOCK) for kernel in [*kernels, kernels[0]]])
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert len([path for path in tmp_path.glob("wp_*")]) == 3
    values = wp.array(np.arange(4.0, dtype=np.float32), device="cpu")
    for kernel in kernels:
        wp.launch(kernel, 4, [values], device="cpu")
    assert values.numpy().tolist() == [0.0, 3.0, 6.0, 9.0]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == there


def test_what_was_begun_is_there_when_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    kernels = [(kernel_of(11.0 + k), LAUNCH_BLOCK) for k in range(3)]
    begin_building("cpu", kernels)
    begin_building("cpu", kernels[:1])  # by another one who needs it too
    build_together("cpu", kernels)
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert sum(path.suffix == ".o" for path in there) == 3
    build_together("cpu", kernels)
    values = wp.array(np.ones(1, np.float32), device="cpu")
    for kernel, _ in kernels:
        wp.launch(kernel, 1, [values], device="cpu")
    assert values.numpy()[0] == 11.0 * 12.0 * 13.0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == there


def test_what_is_compiled_ahead_is_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a GPU, here for a CPU."""
    wp.init()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    kernel = kernel_of(29.0)
    _compile("cpu", kernel.module, 1)
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert sum(path.suffix == ".o" for path in there) == 1 and not kernel.module.execs
    values = wp.array(np.ones(1, np.float32), device="cpu")
    wp.launch(kernel, 1, [values], device="cpu")
    assert values.numpy()[0] == 29.0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == there


@pytest.mark.gpu
def test_kernels_of_a_gpu_are_compiled_while_the_caller_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And loaded with as many threads to a block as they will be launched with."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    values = wp.array(np.ones(1, np.float32), device="cuda:0")
    first, others = kernel_of(31.0), [(kernel_of(37.0 + k), block) for k, block in enumerate((64, 256, 1024))]
    build_together("cuda:0", [(first, LAUNCH_BLOCK)])
    with wp.ScopedCapture("cuda:0") as capture:
        begin_building("cuda:0", others)
        for _ in range(20):
            wp.launch(first, 1, [values], device="cuda:0")
    assert not any(kernel.module.execs for kernel, _ in others)
    build_together("cuda:0", others)
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert sum(path.suffix in (".cubin", ".ptx") for path in there) == 4
    wp.capture_launch(capture.graph)
    values.fill_(1.0)
    for kernel, block in others:
        wp.launch(kernel, 1, [values], device="cuda:0", block_dim=block)
    assert values.numpy()[0] == 37.0 * 38.0 * 39.0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == there


@pytest.mark.gpu
def test_an_error_of_a_gpus_compiler_is_told() -> None:
    @wp.kernel(module="unique", enable_backward=False)
    def wrong(values: wp.array(dtype=wp.float32)):
        values[0] = no_such_name  # noqa: F821

    begin_building("cuda:0", [(wrong, LAUNCH_BLOCK)])
    with pytest.raises(Exception, match="no_such_name"):
        build_together("cuda:0", [(wrong, LAUNCH_BLOCK)])


def test_an_error_of_the_compiler_is_told() -> None:
    @wp.kernel(module="unique", enable_backward=False)
    def wrong(values: wp.array(dtype=wp.float32)):
        values[0] = no_such_name  # noqa: F821

    with pytest.raises(Exception, match="no_such_name"):
        build_together("cpu", [(kernel_of(7.0), LAUNCH_BLOCK), (wrong, LAUNCH_BLOCK)])
    with pytest.raises(Exception, match="no_such_name"):
        begin_building("cpu", [(wrong, LAUNCH_BLOCK)])
        build_together("cpu", [(wrong, LAUNCH_BLOCK)])
