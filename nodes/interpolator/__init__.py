"""Makes the frames between keyframes, and samples of single pixels between the frames.

The way of the data:

1. `node.py`, declared in `declaration.py`, takes keyframes and /state from the bus; `messages.py` makes what it
   publishes.
2. `interpolator.py` holds the last keyframe (A) until the next one (B) ends a gap; `luminance.py` and
   `image_kernels.py` turn images into what is interpolated, and `pixel_means.py` averages the samples of supersampled
   pixels once their frames are made. `separate.py` has an interpolator for each look of the
   world, `many_gaps.py` makes several gaps at once; `making.py` makes the one that a node's parameters and environments
   ask for, and `warm_up.py` makes up keyframes so that all is compiled before the first real one.
3. A method makes the frames of a gap. `keyframe.py` has its interface, `methods.py` the list: `rigid/` reprojects by
   the poses of bodies, `splat/` warps by motion vectors, `passthrough.py` shows keyframes as they are. `relight/` tells
   `rigid` where light changes in between; `displacement_kernels.py` is what all of them know of motion.
4. `refine/` takes `samples.py`: further samples of single pixels between the frames of `rigid`.

`auto/` chooses a method by measurements; `video/` makes frames between those of a video.
"""
