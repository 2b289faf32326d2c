"""Computes the radiance of what the raster has found, by kernels that put materials, lights and shadows together."""
