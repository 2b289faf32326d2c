"""Makes the frames between two frames of a video: the splat along optical flow, or a class of the user's."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import warp as wp

from evis.config.suggestions import did_you_mean
from nodes.interpolator.keyframe import KeyframeView, Method
from nodes.interpolator.splat.splat import make_splat
from nodes.interpolator.video.flow import Flow

METHODS_KEPT = 4
"""A method is made for one number of sub-frames; those of the last few numbers are kept."""
BEHIND = 1.5
"""Depth of pixels whose flow is not to be trusted, beside 1 of all others, which hide them where both land."""
MOST_THREADS = 8


class FrameInterpolator(Protocol):
    """Makes frames between two frames; what `--interpolator my_module:MyInterpolator` names. Made without arguments."""

    def between(self, a: np.ndarray, b: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Makes the frames at some times between two consecutive frames.

        Args:
            a, b: float32 [H, W] linear luminance, or [H, W, 3] linear RGB with --colour; not to be written to.
            at: float64 [K], ascending times within the gap: above 0 (a) and below 1 (b).

        Returns:
            float32 [K, H, W] or [K, H, W, 3], linear.
        """
        ...


class SplatBetween:
    """Moves both frames along the flow between them and blends them by time.

    The splat (nodes.interpolator.splat) goes from b back with a in the holes, and from a forward with b in the holes.
    The blend of the two begins as a and ends as b, so that what changes without moving, a lamp or a flow that is wrong,
    fades over the gap instead of jumping.
    """

    def __init__(self) -> None:
        self._methods: dict[tuple[int, ...], Method] = {}
        self._threads = min(MOST_THREADS, len(os.sched_getaffinity(0)))

    def along(self, flow: Flow, a: np.ndarray, b: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Makes the frames between two frames at equal steps.

        Args:
            flow: between a and b.
            a, b: float32 [H, W] or [H, W, 3], linear.
            at: float64 [K], i / (K + 1) for i = 1 .. K.

        Returns:
            float32 [K, H, W] or [K, H, W, 3].
        """
        steps = len(at) + 1
        method = self._method(a.shape, steps)
        depths = [np.where(agrees, 1.0, BEHIND).astype(np.float32) for agrees in (flow.agrees_a, flow.agrees_b)]
        # the method takes motion backwards: where a pixel was in the frame before
        back = _views((a, b), depths, (-flow.forward, flow.backward))
        forth = _views((b, a), depths[::-1], (-flow.backward, flow.forward))
        from_b, from_a = (self._made(method, views, steps) for views in (back, forth))
        share = at.astype(np.float32).reshape(-1, *[1] * a.ndim)
        blend: np.ndarray = from_a[-2::-1] * (1 - share)
        blend += from_b[:-1] * share
        return blend

    def _method(self, shape: tuple[int, ...], steps: int) -> Method:
        key = (*shape, steps)
        if key in self._methods:
            self._methods[key] = self._methods.pop(key)
        else:
            channels = 3 if len(shape) == 3 else 1
            made = make_splat(shape[0], shape[1], 1, steps, channels=channels, threads=self._threads)
            self._methods[key] = made
            if len(self._methods) > METHODS_KEPT:
                del self._methods[next(iter(self._methods))]
        return self._methods[key]

    def _made(self, method: Method, views: tuple[KeyframeView, KeyframeView], steps: int) -> np.ndarray:
        out = np.empty((1, steps, *views[0].image.shape[1:]), np.float32)
        method.between(*views, np.zeros(1, bool), out)
        return out[0]


def _views(images: Any, depths: Any, motions: Any) -> tuple[KeyframeView, KeyframeView]:
    first, second = (KeyframeView(*(_on_host(array) for array in each)) for each in zip(images, depths, motions))
    return first, second


def _on_host(array: np.ndarray) -> Any:
    return wp.array(np.ascontiguousarray(array[None]), dtype=wp.float32, device="cpu")


def load_interpolator(target: str) -> FrameInterpolator:
    """Makes the user's interpolator, named as nodes are in launch files: `package.module:Class`.

    Modules are looked for in the current folder too. Raises ValueError with one line.
    """
    module_name, _, name = target.partition(":")
    if not module_name or not name:
        raise ValueError(f"interpolator '{target}': write it as my_module:MyInterpolator")
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        raise ValueError(f"interpolator '{target}': {module_name} cannot be imported: {_line(error)}") from None
    kind = getattr(module, name, None)
    if not (isinstance(kind, type) and callable(getattr(kind, "between", None))):
        known = [k for k, v in vars(module).items() if isinstance(v, type) and hasattr(v, "between")]
        raise ValueError(f"interpolator '{target}': no class {name} with a method `between`{did_you_mean(name, known)}")
    try:
        made: FrameInterpolator = kind()
    except Exception as error:
        raise ValueError(f"interpolator '{target}' cannot be made: {_line(error)}") from None
    return made


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
