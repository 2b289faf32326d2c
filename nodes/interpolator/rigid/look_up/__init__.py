"""Looks up surface points in the keyframes of a gap.

`portion_kernels.py` finds the point that a pixel shows at a sub-frame; `look_up_kernels.py` finds where a keyframe
shows that and interpolates ln I there (`log_kernels.py`). `both_keyframes_kernels.py` does so in both;
`gather_kernels.py` blends what they tell, and lists what neither does. `texture_kernels.py` takes the albedo of fine
textures out of the light of a keyframe, and puts that of the sub-frame in.
"""
