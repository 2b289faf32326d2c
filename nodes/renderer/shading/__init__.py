"""Computes the radiance of what the raster has found, by kernels that put materials, lights and shadows together.

`options.py` has what may be asked for, and `surfaces.py` brings the materials to the device. `shadow_pass.py` first
casts the rays to lights without size for all pixels (`shadow_kernels.py`). Then `shading_kernels.py` takes every pixel:
its surface and material (`material_kernels.py`), what is remembered of the light on still surfaces
(`cache_kernels.py`), the sum of all light, and radiance or luminance of it (`radiance_kernels.py`). `point_kernels.py`
does the same for a point of a triangle that no pixel need see.
"""
