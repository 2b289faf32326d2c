"""Computes the faults of a real sensor, and the random numbers that they are drawn by.

`fixed_pattern.py` draws what differs from pixel to pixel: thresholds, leak rates, hot pixels. `leak_kernels.py` is the
leak, `noise_kernels.py` shot noise and hot pixels, `refractory_kernels.py` the refractory period; `random_kernels.py`
names the streams of random numbers.
"""
