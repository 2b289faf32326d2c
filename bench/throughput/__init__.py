"""Measures whole runs of the graph on one device: how fast, how busy the device is, and what bounds its kernels."""
