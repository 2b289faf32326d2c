"""Compiles kernels side by side before they are launched, for at a launch each is compiled by itself."""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import warp as wp

from evis.gpu.compilers import ahead_of_compiler, share_compilers
from evis.warp_start import start_warp

start_warp()

LAUNCH_BLOCK = 256
"""Threads of a block where a launch does not say."""
MOST_AT_ONCE = 12
"""A compiler takes 100 to 300 MB."""
FEWEST_CORES = 2
"""With one there is nothing to share. On a CPU a compiler reads Warp's headers once for each thread, for 1.2 s, while
the kernels of a scene take some 15 s."""

Key = tuple[str, Any, int | None]
"""Device, module, and threads of a block on a GPU."""

_begun: dict[Key, Future[None]] = {}
"""What is being built for a CPU, or was and has not been asked for yet."""
_compiled: dict[Key, Future[None]] = {}
"""The same of a GPU, where it is compiled alone."""


@cache
def _helpers() -> ThreadPoolExecutor:
    """Makes the pool of threads that build kernels, one less than there are cores, as who waits builds too.

    Its threads stay, and so do the headers that their compilers have read.
    """
    return ThreadPoolExecutor(min(MOST_AT_ONCE, len(os.sched_getaffinity(0))) - 1, "build")


def begin_building(device: Any, kernels: Iterable[tuple[wp.Kernel, int]]) -> None:
    """Has kernels compiled, and of a CPU loaded, while the caller does something else.

    Of a GPU they are loaded by `build_together`, for nothing may be while launches are recorded. kernels: as of that,
    which is to be called before one of them is launched: what is not there by then would be compiled twice.
    """
    if wp.get_device(device).is_cpu:
        _begin(device, kernels)
    elif len(os.sched_getaffinity(0)) >= FEWEST_CORES:
        share_compilers()
        for kernel, block in kernels:
            key = wp.get_device(device).alias, kernel.module, block
            if key not in _compiled:
                _compiled[key] = _helpers().submit(_compile, *key)


def build_together(device: Any, kernels: Iterable[tuple[wp.Kernel, int]]) -> None:
    """Compiles kernels and loads them on a device, several at once; from Warp's cache what is there.

    kernels: those that take longest first, each with the threads of a block that it will be launched with, which count
    on a GPU only. One that is not launched after all costs the time to compile it. Raises what a launch would.
    """
    building = _begin(device, kernels)
    for key, future in building.items():
        if future.cancel():  # nobody has begun with it
            _build(*key)
    for key, future in building.items():
        if not future.cancelled():
            wait([future])
        _begun.pop(key, None)
    for future in building.values():
        if not future.cancelled():
            future.result()


def _begin(device: Any, kernels: Iterable[tuple[wp.Kernel, int]]) -> dict[Key, Future[None]]:
    if len(os.sched_getaffinity(0)) < FEWEST_CORES:
        return {}  # a launch does the same
    where = wp.get_device(device)
    if where.is_cuda:
        share_compilers()
    wanted = ((where.alias, kernel.module, None if where.is_cpu else block) for kernel, block in kernels)
    keys = list(dict.fromkeys(wanted))
    if where.is_cpu:  # what is there is loaded at its launch as fast as on another thread, which takes turns with this
        keys = [key for key in keys if key in _begun or not _is_kept(key[1])]
    return {key: _begun.get(key) or _begun.setdefault(key, _helpers().submit(_build, *key)) for key in keys}


def _is_kept(module: Any) -> bool:
    """Tells whether Warp's cache has a module as a CPU runs it, with one thread to a block."""
    return os.path.isdir(os.path.join(str(wp.config.kernel_cache_dir), module.get_module_identifier(1)))


def _build(device: str, module: Any, block: int | None) -> None:
    begun = _compiled.pop((device, module, block), None)
    if begun is not None and not begun.cancel():
        wait([begun])  # what went wrong goes wrong again, and is told
    wp.force_load(device, [module], block, max_workers=0)


def _compile(device: str, module: Any, block: int) -> None:
    """Compiles a module into Warp's cache, and does not load it.

    Warp's compile_aot_module does the same for the number of threads to a block that a module has by default.
    """
    with ahead_of_compiler():
        module.get_module_hash(block)
        module._compile(wp.get_device(device), options=module.resolved_options[block])
