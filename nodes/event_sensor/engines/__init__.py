"""Turns frames into events: an engine keeps the state of the pixels and launches the kernels of the sensor's model.

`interface.py` says what an engine does, and `engine.py` chooses one: that of curves and faults is `nonideal.py`, that
of the paper's equations `paper.py`; those of the ideal sensor are in the rooms of the devices.
"""
