"""Implements methods `splat` and `splat-quadratic`, the paper's bidirectional warp by motion vectors.

`splat.py` has the method, and `gap_before.py` with `pace_kernels.py` scales motion to the gap that it is used in;
`quadratic.py` with `bend_kernels.py` makes paths of it that are parabolas. `warp_kernels.py` states the equations of
the warp, once for every device. How the work is laid out: `cpu.py` and `cuda.py`, with `cpu_source_kernels.py` and
`cuda_source_kernels.py`, which make sources of pixels, and `cpu_sum_kernels.py` and `cuda_kernels.py`, which sum them
where they land; `cpu_kernels.py` makes the sub-frames of a gap of these, one after the other.
"""
