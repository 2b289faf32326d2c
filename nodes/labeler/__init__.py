"""Computes exact ground truth at the stamps of the event packets.

`node.py` joins the state and images of one stamp and publishes a Labels message, only with what `kinds.py` lists and
somebody asked for:

- of bodies, out of the state: `body_labels.py`;
- of what a pixel shows, made of depth and ids: flow (`flow_field.py`) and boxes (`image_labels.py`) of what
  `box_groups.py` chooses, by `image_label_kernels.py`;
- of the scene's meshes, `mesh_labels.py`: boxes that turn with bodies (`oriented_boxes.py`), and by rays
  (`ray_caster.py`, `ray_caster_kernels.py`) at the time of each event (`event_labels.py`, paired with their packets by
  `event_pairing.py`), or at both ends of an interval (`interval_flow.py`, by `instants.py` and `instant_kernels.py`).
  `motion_history.py` knows where bodies were, and `motion_kernels.py` where they are between the states.

`instance_tables.py` looks up what the camera's info tells of the instances in an image, and `projection.py` relates its
places to directions, for flow and for rays.
"""
