"""Implements method `splat`, the paper's bidirectional warp by motion vectors, on a CPU and on a GPU."""
