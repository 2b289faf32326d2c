"""How the sequential decoders run as Warp CPU kernels (dim = 1): one loop over the words, state in an int64 vector.

Each kernel is a module of its own (`kernels_<codec>.py`), so that only the codec in use is compiled. The numpy twin of
each is `Decoder.decode_words` of its codec; state layouts are described there. `out` = next word, events, triggers,
time [us] of the event at the cut or -1, side words.
"""

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_WARNING


def view(array: np.ndarray) -> wp.array:
    """The same memory as a Warp array on the CPU."""
    return wp.array(array, dtype=wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)


def launch(kernel: wp.Kernel, inputs: list, outputs: list) -> None:
    """One thread over the whole buffer. The first output is the decoder's state, a numpy vector."""
    wp.launch(kernel, dim=1, inputs=inputs, outputs=[view(outputs[0]), *outputs[1:]], device="cpu")
