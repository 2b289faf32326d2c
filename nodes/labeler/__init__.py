"""Computes exact ground truth at the stamps of the event packets.

`node.py` joins the state and images of one stamp and publishes a Labels message, only with what `kinds.py` lists and
somebody asked for: `body_labels.py` takes it out of the state, `image_labels.py` makes it of depth and ids,
`mesh_labels.py` of the scene's meshes, by rays (`ray_caster.py`) at the time of each event (`event_labels.py`, paired
with their packets by `event_pairing.py`) or at both ends of an interval (`interval_flow.py`).
"""
