"""Finds what is in the way of light: occluders, rays against them, grids that save rays.

`occlusion.py` holds the instances as occluders, with a tree of triangles for each mesh and for many still ones together
(`merged.py`); `occlusion_kernels.py` places the trees, and `boxes.py` finds the boxes of instances. `ray_kernels.py`
casts a shadow ray. `grid.py` with `grid_kernels.py` looks up what can be in the way of a light that stands still.
"""
