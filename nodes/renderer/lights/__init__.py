"""Computes the light of point, spot, directional and area lights, and of the sky.

`features.py` tells kernels which of these a scene has. `lights.py` holds the lights and `place_kernels.py` brings them
into the camera's frame; `light_kernels.py` describes them to kernels, and `surface_point_kernels.py` the point that
they light. `direct_kernels.py` sums what a point gets: from lights without size, and from area lights
(`area_kernels.py`, in closed form by `rectangle_kernels.py` and by the samples of `area_sample_kernels.py`). `sky.py`
and `sky_kernels.py` are the sky, of which a glossy lobe gathers by `lobe_kernels.py` on a CPU, eight samples at a time
(`specular_means.h`).
"""
