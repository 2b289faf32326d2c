"""Implements methods `splat` and `splat-quadratic`, the paper's bidirectional warp by motion vectors.

`splat.py` has the method, and `gap_before.py` with `pace_kernels.py` scales motion to the gap that it is used in;
`quadratic.py` with `bend_kernels.py` makes paths of it that are parabolas. `warp_kernels.py` states the equations of
the warp, once for every device. How the work is laid out: `cpu.py` with `cpu_kernels.py`; `cuda.py` with
`cuda_source_kernels.py`, which makes sources of pixels, and then `cuda_kernels.py`, which sums them where they land.
"""
