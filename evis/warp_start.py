"""Starts Warp, the kernel library: how it compiles, and without the remarks that its native part prints."""

from __future__ import annotations

import os
import sys

INLINED = "-inline-threshold=9000", "-inline-threshold=40000"
"""LLVM's limit of what is written out where it is called on a CPU, as Warp has it and as it is here. Kernels hand each
other structs of 0.5 to 4 kB by value, which are copied wherever a call remains one: with the higher limit the rays of
further samples take half their time, all of a gap 3 to 6 % less, the robot's arm with frames alone 10 %, and compiling
at most 14 % more."""


def start_warp() -> None:
    """Starts Warp. That a machine has no GPU driver is news only to who asks for a GPU, and is said then in our words.

    Cheap when Warp runs already. Importing this module does not import Warp. Raises OSError, with the remedy, where the
    folder of compiled kernels cannot be made.
    """
    import warp as wp

    from evis.files.home import user_folder
    from evis.warp_cache import renew_damaged
    from evis.warp_headers import share_headers

    asked = wp.config.kernel_cache_dir
    if asked is None and "WARP_CACHE_PATH" not in os.environ:
        try:
            user_folder("XDG_CACHE_HOME", ".cache")  # without one Warp makes a folder named ~ where the program stands
        except OSError as error:
            raise OSError(f"compiled kernels cannot be kept: {error}, or WARP_CACHE_PATH") from None
    wp.config.log_level = wp.LOG_WARNING
    if wp.config.cpu_compiler_flags:
        wp.config.cpu_compiler_flags = wp.config.cpu_compiler_flags.replace(*INLINED)
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)  # the native part writes there itself
        wp.init()
        share_headers()
        renew_damaged()
    except OSError as error:
        folder = wp.config.kernel_cache_dir or error.filename
        wp.config.kernel_cache_dir = asked  # the next start would take the folder for a parent
        raise OSError(
            f"compiled kernels cannot be kept in {folder} ({error.strerror}): "
            "set WARP_CACHE_PATH or XDG_CACHE_HOME to a folder that can be written"
        ) from None
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
