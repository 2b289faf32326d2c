"""Prepares the input of a sensor before its kernels: frames and further samples as arrays on its device, checked.

`arrays.py` takes images of any library, `sample_lists.py` and `further.py` the further samples of single pixels between
frames, which `further_kernels.py` checks; `batch.py` is what kernels get, and by `between_kernels.py` they take a pixel
from one of its samples to the next. `timeline.py` checks that time goes on, `limit.py` that no gap in it asks for more
events than there is memory for, and `look_ahead.py` holds back the last frame for curves that need the one after a
step.
"""
