"""Follows a pixel over a surface from one instant to the next, and requests a sample wherever ln I bends.

`run_path_kernels.py` takes a run part by part, between the instants at which light changes. A part goes along a
keyframe that shows the surface (`keyframe_path_kernels.py`, which looks points up by `keyframe_point_kernels.py`), or
along a texture that is finer than its pixels (`texture_path_kernels.py`, where `texture_charts.py` finds it to lie on
one plane), or else by the scale of its albedo (`albedo_scale.py`, `albedo_path_kernels.py`). `motion_kernels.py` bounds
how far bodies are off straight paths, which tells where points have to be looked up anew.
"""
