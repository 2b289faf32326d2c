"""Computes light over several surfaces, by paths.

`paths.py` prepares the sources of light and launches `path_kernels.py`, which begins paths at the surfaces that pixels
show. `walk_kernels.py` follows one from vertex to vertex: `trace_kernels.py` finds what its rays hit,
`surface_kernels.py` what is reflected there, `aim_kernels.py` the light that comes straight from a source;
`sampling_kernels.py` draws the random numbers and directions.
"""
