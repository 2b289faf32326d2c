"""Schedules the sensor's work on a CPU: which pixels are sensed, in which order, and how events get in order.

The ideal sensor: `ideal.py` keeps the state and launches `ideal_kernels.py`, which takes blocks of pixels through steps
by `simd_kernels.py` (`ideal_simd.h`, with the logarithm of `logarithm.h`). Pixels with further samples are taken by
`further.py` and `further_kernels.py` (`further.h`).

With curves and faults: `nonideal_kernels.py` takes rows. Active pixels are found by `active_kernels.py` (`active.h`),
of curves by `run_kernels.py`, and sensed by the model; of one that crosses several thresholds the times are found
together by `crossings_simd_kernels.py` (`crossings_simd.h`).

`event_list.py` holds the events of a call; `order.py`, by `order_kernels.py` (`order.h`), sorts and unpacks them.
"""
