"""Computes rigid motions, their interpolation, and the pinhole camera, in float64 numpy."""
