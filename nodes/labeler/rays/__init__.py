"""Computes what a camera sees of the scene's meshes at instants of which there is no image.

`motion_history.py` knows where bodies were, and `motion_kernels.py` where they are between the states. `ray_caster.py`
with `ray_caster_kernels.py` answers questions that have a time each, such as events; `instants.py` with
`instant_kernels.py` sees a whole image at one time, and where its points are at another.
"""
