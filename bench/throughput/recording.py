"""Records every kernel, copy and fill of a device, with its time by the device's own clock."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from bench.roofline.launches import symbol, symbol_of, watch


class Recording:
    """Records the kernels, copies and fills of a device from its making to `end`.

    By CUPTI where PyTorch is installed, which sees the kernels within graphs and when each began; otherwise by Warp's
    events, to which a graph is one thing and whose times add up. On a CPU by the processor's time that launches take.
    """

    def __init__(self, device: wp.Device) -> None:
        self.over = False
        self._device = device
        self._profile: Any = None
        self._cupti = device.is_cuda and importlib.util.find_spec("torch") is not None
        if self._cupti:
            from torch.profiler import ProfilerActivity, profile

            self._profile = profile(activities=[ProfilerActivity.CUDA])
            self._profile.start()
        elif device.is_cuda:
            wp.timing_begin(cuda_filter=wp.TIMING_ALL)
        else:
            self._launched: list[tuple[str, int, int]] = []
            watch(self._beside)

    @contextmanager
    def _beside(self, kernel: wp.Kernel, device: Any) -> Iterator[None]:
        began = time.thread_time_ns()
        yield
        took = time.thread_time_ns() - began
        if name := symbol(kernel):
            self._launched.append((name, began, took))

    def end(self) -> dict[str, Any]:
        """Returns `by`, `busy_s`, the time in which the device did anything [s], and `kernels`: name -> [calls, s]."""
        self.over = True
        if self._device.is_cpu:
            busy = union(span[1:] for span in self._launched)
            return {"by": "launches", "busy_s": busy / 1e9, "kernels": by_name(self._launched)}
        wp.synchronize_device(self._device)
        if not self._cupti:
            spans = [
                (symbol_of(result.name.removeprefix("forward kernel ")), 0, round(1e6 * result.elapsed))
                for result in wp.timing_end()
            ]
            return {"by": "events", "busy_s": sum(ns for _, _, ns in spans) / 1e9, "kernels": by_name(spans)}
        self._profile.stop()
        found = self._profile.profiler.kineto_results.events()
        spans = [(symbol_of(e.name()), e.start_ns(), e.duration_ns()) for e in found if "CUDA" in str(e.device_type())]
        return {"by": "cupti", "busy_s": union(span[1:] for span in spans) / 1e9, "kernels": by_name(spans)}


def union(spans: Iterable[tuple[int, int]]) -> int:
    """Adds up the time in which at least one of the spans (begin, length) lasts."""
    total, until = 0, -(1 << 63)
    for begin, length in sorted(spans):
        end = begin + length
        total += max(0, end - max(begin, until))
        until = max(until, end)
    return total


def by_name(spans: Iterable[tuple[str, int, int]]) -> dict[str, list[float]]:
    """Adds up calls and seconds of the spans (name, begin, length in ns) of each name, the longest first."""
    found: dict[str, list[float]] = {}
    for name, _, ns in spans:
        calls = found.setdefault(name, [0, 0.0])
        calls[0] += 1
        calls[1] += ns / 1e9
    return dict(sorted(found.items(), key=lambda item: -item[1][1]))
