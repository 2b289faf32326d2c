"""Surrounds every launch of a Warp kernel in this process with a context of the caller's."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import warp as wp

Beside = Callable[[wp.Kernel, Any], AbstractContextManager[None]]
"""Gives what is to surround the launch of a kernel on a device."""


def watch(beside: Beside) -> None:
    """Enters the context `beside` around each launch from now on, by `wp.launch` or of a recorded command."""
    launch, again = wp.launch, wp.Launch.launch

    def launched(kernel: Any, *args: Any, **options: Any) -> Any:
        if options.get("record_cmd"):
            return launch(kernel, *args, **options)
        stream = options.get("stream")
        with beside(kernel, wp.get_device(options.get("device")) if stream is None else stream.device):
            return launch(kernel, *args, **options)

    def launched_again(self: Any, *args: Any, **options: Any) -> None:
        with beside(self.kernel, self.device):
            again(self, *args, **options)

    wp.launch = launched
    wp.Launch.launch = launched_again  # type: ignore[method-assign]


def symbol(kernel: wp.Kernel) -> str:
    """Gives the name that a kernel has in its module: `sense_2c3fb0a1`, unlike that of its other variants.

    "" for one that is not loaded, as it was launched with no threads only.
    """
    return "" if kernel.hash is None else str(kernel.get_mangled_name())


def symbol_of(name: str) -> str:
    """Gives the name that a kernel has in its module, as `symbol` does, from the name that a profiler gives it."""
    return name.split("(")[0].removeprefix("void ").split("<")[0].removesuffix("_cuda_kernel_forward").strip()
