"""Counts the bytes and operations of each kernel, in a process whose kernels are compiled with counters in them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp
from warp._src import context  # type: ignore[import-untyped]

from bench.roofline.counted_source import counted, kind_of
from bench.roofline.launches import symbol, watch
from evis.gpu.cuda_graph import CudaGraphs
from nodes.event_sensor.cuda.pipeline import Pipeline

FIGURES = ("bytes", "operations", "native")


class Counting:
    """Counts launch by launch the bytes and operations of the kernels of a device that are compiled after its making.

    Warp's cache must be empty, and is of no use to other processes afterwards: WARP_CACHE_PATH. Launches that are
    otherwise recorded as graphs are done one by one, so that each has figures of its own.
    """

    def __init__(self, device: wp.Device) -> None:
        self._device = device
        self._counters: wp.array = wp.zeros(len(FIGURES), dtype=wp.uint64, device=device)
        self.kernels: dict[str, dict[str, Any]] = {}
        self.on = False
        generate = context.ModuleBuilder.codegen

        def codegen(builder: Any, kind: str) -> str:
            source = generate(builder, kind)
            if (kind == "cpu") != device.is_cpu:
                return str(source)
            native = {
                f.native_func: kind_of(
                    f.native_snippet, any(wp.types.is_array(t) for t in f.input_types.values()), device.is_cuda
                )
                for f in builder.functions
                if f.native_snippet is not None
            }
            return counted(source, self._counters.ptr, native)

        replaced = (
            (context.ModuleBuilder, "codegen", codegen),
            (CudaGraphs, "run", _at_once),
            (Pipeline, "_replay", _now),
        )
        for owner, name, function in replaced:
            setattr(owner, name, function)
        watch(self._beside)

    def _read(self) -> np.ndarray:
        return np.array(self._counters.numpy(), np.uint64)

    @contextmanager
    def _beside(self, kernel: wp.Kernel, device: wp.Device) -> Iterator[None]:
        if not self.on or device != self._device or device.is_capturing:
            yield
            return
        before = self._read()
        yield
        found = self._read() - before
        of_kernel = self.kernels.setdefault(
            symbol(kernel), {"name": kernel.key, "calls": 0, **dict.fromkeys(FIGURES, 0)}
        )
        of_kernel["calls"] += 1
        for figure, value in zip(FIGURES, found):
            of_kernel[figure] += int(value)


def _at_once(graphs: CudaGraphs, key: Hashable, launch: Callable[[], None]) -> None:
    """Stands for `CudaGraphs.run`."""
    launch()


def _now(pipeline: Pipeline, call: Any, name: Any, launch: Callable[[], Any]) -> None:
    """Stands for what a pipeline does with a sequence of launches."""
    launch()
