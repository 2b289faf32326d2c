"""Finds the kernels that a function launches without running them, so that they can be compiled side by side.

MuJoCo Warp makes its kernels where it launches them, for the sizes of a model, and Warp compiles each when it is first
launched: some sixty, one after the other, for minutes on a GPU.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from evis.gpu.building import LAUNCH_BLOCK

Launched = list[tuple[wp.Kernel, int]]
"""Kernels, and the threads of a block that each was to be launched with."""


def launches(work: Callable[[], None]) -> Launched:
    """Runs `work` with its kernel launches noted in place of done, and returns these."""
    found: Launched = []
    with _noted(found):
        work()
    return found


@contextmanager
def _noted(found: Launched) -> Iterator[None]:
    """Notes launches of this thread in the place of launching; those of others go their way."""
    owner, real = threading.get_ident(), (wp.launch, wp.launch_tiled, wp.capture_while)

    def noted(launch: Callable[..., Any]) -> Callable[..., Any]:
        def note(kernel: wp.Kernel, *args: Any, **options: Any) -> Any:
            if threading.get_ident() != owner:
                return launch(kernel, *args, **options)
            found.append((kernel, options.get("block_dim", LAUNCH_BLOCK)))
            return None

        return note

    def once(condition: Any, while_body: Callable[..., Any], stream: Any = None, **options: Any) -> Any:
        if threading.get_ident() != owner:
            return real[2](condition, while_body, stream, **options)
        return while_body(**options)

    wp.launch, wp.launch_tiled, wp.capture_while = noted(real[0]), noted(real[1]), once  # type: ignore[assignment]
    try:
        yield
    finally:
        wp.launch, wp.launch_tiled, wp.capture_while = real
