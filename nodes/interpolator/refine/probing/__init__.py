"""Chooses how often all surfaces are drawn between two frames, so that nothing thin or fast passes unseen.

Before any probe is drawn, from poses alone: `brief_appearances.py` with `appearance_kernels.py` (what is in the image
for a short time) and `narrow_kernels.py` (what is narrower than a pixel), and `curved_motion.py` with
`curved_motion_kernels.py` (what does not go straight from one probe to the next); `boxes.py`, `box_kernels.py`,
`body_boxes.py` and `frustum.py` describe things and the image to them. Then `probes.py` draws z-buffers until there are
enough, as `thin_kernels.py` tells, which counts what passes pixels unseen between two of them at the speeds of
`camera_motion.py`, and `probe_kernels.py`, which counts what is in one alone.
"""
