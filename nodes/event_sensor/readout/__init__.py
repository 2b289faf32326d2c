"""Computes what comes after the threshold: the arbiter's rate, the order of events, and the delays of their times.

`readout.py` models it, by `readout_kernels.py` (`readout.h`). `last_events.py` holds what a call of the sensor gave
until it is read, `packet.py` the events of a message in columns, and `device_events.py` those that stay on a device.
"""
