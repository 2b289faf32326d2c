"""Finds the runs of one surface that each pixel shows in a window, and requests the samples that each run needs.

`single_surface_kernels.py` goes through all pixels: it serves those that show one surface, and lists the others.
`silhouette_kernels.py` finds pixels beside a silhouette whose corners come and go between probes. Of what is listed
`transition_kernels.py` finds between which instants surfaces give way to others, `transition_time_kernels.py` when
exactly and at which point of an outline, and `run_kernels.py` requests the samples of the runs between these, and of
these points.
"""
