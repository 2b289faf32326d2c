"""Radiance of what the raster has found: kernels that put materials, lights and shadows together."""
