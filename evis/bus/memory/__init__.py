"""Keeps the arrays of messages: slots of host memory and of a GPU, read from this process and from others.

`lending.py` lends slots to whoever publishes: `slots.py` on the host, `device.py` on a GPU. `placing.py` puts a message
into a host slot, which `mapping.py` maps in another process; `cuda_ipc.py` does both for GPU memory.
"""
