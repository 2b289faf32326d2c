"""Finds where the light on a surface changes between two keyframes, so that what they show there must not be carried
over.

`features.py` lists what of a scene can change light at all, before anything is compiled. In every gap `change.py` holds
lights and shadow casters at both keyframes and at the sub-frames; `sweep.py` with `sweep_kernels.py` computes the boxes
that moving casters sweep, `boxes_kernels.py` and `swept_kernels.py` find by these what may be shadowed. Then
`change_kernels.py` compares the light on one point at a sub-frame with that at the keyframes, in closed form, and
`line_kernels.py` tells from one sub-frame to the next whether it stays on a line.
"""
