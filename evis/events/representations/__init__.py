"""Converts events to images for a network: voxel grid, event stack, count image, time surface; on a CPU or where the
events are.

    from evis.events.representations import voxel_grid
    grid = voxel_grid(events, bins=5, height=260, width=346).values

`columns.py` (`column_kernels.py`) checks the events and their window, then `voxels.py` and `stack.py` add them up
(`sum_kernels.py`), or `surface.py` (`surface_kernels.py`) keeps the latest of each pixel. Every sum is one of whole
numbers, so that the order in which a GPU adds does not show in the result.
"""

from evis.events.representations.columns import Representation
from evis.events.representations.stack import count_image, event_stack
from evis.events.representations.surface import TimeSurface, time_surface
from evis.events.representations.voxels import voxel_grid

__all__ = ["Representation", "TimeSurface", "count_image", "event_stack", "time_surface", "voxel_grid"]
