"""Finds where the light on a surface changes between two keyframes, so that what they show there must not be carried
over.

`features.py` lists what of a scene can change light at all, before anything is compiled. In every gap `change.py` holds
lights and shadow casters at both keyframes and at the sub-frames; `sweep.py` with `sweep_kernels.py` computes the boxes
that moving casters sweep, and `boxes_kernels.py` and `swept_kernels.py` find by these what may be shadowed. For a point
at a sub-frame, as `change_kernels.py` describes it, `flag_kernels.py` tells what may change its light at all,
`light_kernels.py` computes that light in closed form, and `relit_kernels.py` compares it with that at the keyframes;
`line_kernels.py` tells from one sub-frame to the next whether it stays on a line.
"""
