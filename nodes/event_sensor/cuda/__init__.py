"""Runs the event sensor on CUDA: frames and events stay on the device, and a call launches one recorded graph.

`pipeline.py` runs calls, several in flight, each in a slot (`slot.py`) with parameters and results where
`call_kernels.py` says; `event_list.py` is what the sensor sees of it. Events come from what `source.py` defines, for
the ideal sensor from `ideal.py`: `active_kernels.py` lists the pixels that may have some, and `ideal_kernels.py` senses
these, with the samples between frames by `further_kernels.py`. With curves and faults they come from an engine that
`relaunched.py` makes a source of (`nonideal_kernels.py`). `order.py` puts them in order, by buckets of time
(`order_kernels.py`) each of which a block sorts (`sort_kernels.py`).
"""
