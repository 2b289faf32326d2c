"""Makes sub-frames between the frames of a video, whose motion is found by optical flow.

`flow.py` finds the motion between two frames, `upsample.py` chooses how many frames it takes, and `between.py` makes
them by the splat, or by a class of the user's.
"""
