"""Defines the event model for any device: a pixel's state, its thresholds, crossing times, noise.

`features.py` says what a kernel has of the model. `sensor_kernels.py` holds the parameters and computes L of a light;
`state_kernels.py` holds the state of pixels, `step_kernels.py` the structs that the following hand to each other.

A pixel's way through a message is `pixel_kernels.py`: `episode_kernels.py` begins it, `sample_kernels.py` reads its
samples, `inactive_kernels.py` tells when nothing can happen, `curve_kernels.py` draws the signal of a step.
`pixel_step_kernels.py` takes it through the step from one happening to the next: `threshold_kernels.py` counts
thresholds, `crossing_kernels.py` finds when they are crossed, `faults/` has leak, noise and refractory period, and
`emission_kernels.py` writes the events as keys (`keys.py`, `key_kernels.py`). `paper_kernels.py` has the paper's
equations as they stand, for comparison; `constants.h` tells an editor what the C++ of the rooms of devices is compiled
with.
"""
