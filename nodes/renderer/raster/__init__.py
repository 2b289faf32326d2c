"""Computes primary visibility: triangles into a z-buffer, through any lens.

`visibility.py` holds a scene, a camera and the z-buffer. `scene_arrays.py` holds what is drawn, in blocks that
`clusters.py` cuts; `bounds_kernels.py` culls them. `raster.py` draws: on a CPU by rows (`row_tiles.py`,
`raster_kernels.py`), on a GPU by lists (`tiled_kernels.py`, `tile_kernels.py`, `shuffle_kernels.py`), both by the edge
functions of `triangle_kernels.py`, which `walk_kernels.py` follows from pixel to pixel (`drawable.h` and `walk.h` eight
at a time), and into the entries of `depth_kernels.py` (`entries.py` on the host). From the z-buffer
`surface_kernels.py` computes the surface point of a pixel, and `output_kernels.py` the geometric images. `lens/` is the
camera.
"""
