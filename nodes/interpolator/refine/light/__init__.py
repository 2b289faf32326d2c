"""Finds when light changes between two frames: lamps that flicker, shadows, beams and highlights that pass.

- Flicker: `flicker.py` computes the marks, instants between which ln of all lamps is straight, and `flicker_kernels.py`
  requests them.
- Shadows and beams: `light_visibility.py` bounds for how short a time one may be on a point, and looks so often which
  lamps a pixel's surface sees (`light_visibility_kernels.py`, by the keys of `lamp_kernels.py`). The bounds come from
  the widths of meshes and their holes (`silhouettes.py`, `silhouette_kernels.py`), of boxes and flat things
  (`box_shadows.py`, `box_shadow_kernels.py`), of gaps between things that move as one (`assemblies.py`), and from their
  speed (`shadow_time_kernels.py`).
- Lamps that move to and fro: `lamp_turns.py` tells how long they go one way.
- Lamps that go by a thing: `passing_lamps.py` tells how long their light, or a spot's beam, is on a point of it.
- Facets of what is shaded round: `facets.py`, `facet_kernels.py`.
- Highlights: `highlights.py`, by how round things are: `curvature.py`.
"""
