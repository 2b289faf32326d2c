"""Turns frames into events: an engine keeps the state of the pixels and launches the kernels of the sensor's model."""
