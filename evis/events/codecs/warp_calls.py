"""Runs the sequential decoders as Warp CPU kernels (dim = 1): one loop over the words, state in an int64 vector.

Each kernel is a Warp module of its own, so that only the codec in use is compiled. The numpy twin of
each is `Decoder.decode_words` of its codec; state layouts are described there. `out` = next word, events, triggers,
time [us] of the event at the cut or -1, side words.
"""

import numpy as np
import warp as wp

from evis.events.codecs.writing_kernels import Sink, Span
from evis.warp_start import start_warp

start_warp()

__all__ = ["Span", "record", "run", "sink", "view"]


def view(array: np.ndarray) -> wp.array:
    """Makes a Warp array on the CPU that shares the memory of a numpy array."""
    return wp.array(array, dtype=wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)


def sink(*columns: np.ndarray) -> Sink:
    """Makes the `Sink` that a kernel writes to, from arrays in the order of its fields."""
    result = Sink()
    for name, column in zip(Sink.vars, columns, strict=True):  # type: ignore[attr-defined]
        setattr(result, name, view(column))
    return result


def record(kernel: wp.Kernel, inputs: list, outputs: list) -> wp.Launch:
    """Records a launch of one thread, to be run again and again with its parameters changed in between."""
    command: wp.Launch = wp.launch(kernel, dim=1, inputs=inputs, outputs=outputs, device="cpu", record_cmd=True)
    return command


def run(kernel: wp.Kernel, inputs: list, outputs: list[np.ndarray]) -> None:
    """Runs a kernel once, with one thread, on whole buffers; numpy arrays are read and written in place."""

    def viewed(value):
        return view(value) if isinstance(value, np.ndarray) else value

    wp.launch(kernel, dim=1, inputs=[viewed(v) for v in inputs], outputs=[viewed(v) for v in outputs], device="cpu")
