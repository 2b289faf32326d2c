"""Computes light over several surfaces, by paths.

`paths.py` prepares the sources of light and launches `path_kernels.py`, which begins paths at the surfaces that pixels
show. `path_tracer_kernels.py` follows one from vertex to vertex: `first_hit_kernels.py` finds what its rays hit,
`vertex_kernels.py` makes a vertex of it, `brdf_kernels.py` says what is reflected there, and `next_event_kernels.py`
adds the light that comes straight from a source; `sampling_kernels.py` draws the random numbers and directions.
"""
