"""Computes exact ground truth at the stamps of the event packets.

`node.py` joins the state and images of one stamp and publishes a Labels message, only with what `kinds.py` lists and
somebody asked for:

- of bodies, out of the state: `body_labels.py`;
- of what a pixel shows, made of depth and ids: flow and boxes (`images/`);
- of the scene's meshes, `mesh_labels.py`: boxes that turn with bodies (`oriented_boxes.py`), and by what a camera sees
  of them at any instant (`rays/`): at the time of each event (`event_labels.py`, paired with their packets by
  `event_pairing.py`), or at both ends of an interval (`interval_flow.py`).

`projection.py` relates places in the image to directions, for flow and for rays.
"""
