"""Defines where a call's parameters, counters and results stand in their arrays."""

import warp as wp

from nodes.event_sensor.model.sensor_kernels import COUNTERS

# Parameters, int64.
IMAGES = wp.constant(0)
"""Address of the luminance, float32 [E, K, H, W, C]."""
T_BASE = wp.constant(1)
SPAN = wp.constant(2)
"""The last stamp less t_base."""
FIRST = wp.constant(3)
"""Address of `first` of the further samples, see batch.SampleLists; 0 where there are none. Then `offset`, `value`."""
OFFSET = wp.constant(4)
VALUE = wp.constant(5)
SHARED = wp.constant(6)
FOUND = wp.constant(7)
"""Address of what was found wrong with them, int64 [1]: unless it is FINE they are not read; 0 = they are fine."""
STAMPS = wp.constant(8)
"""From here on: K stamps, then for each environment not 0 where an episode begins."""

# Counters, int64, beyond those of nodes.event_sensor.model.sensor_kernels.
ACTIVE = wp.constant(len(COUNTERS) + 1)
"""Pixels that are listed."""
FULL_FROM = wp.constant(len(COUNTERS) + 2)
"""The first place of the list of events that a pixel could not use, where one found no room."""
BLOCKED = wp.constant(len(COUNTERS) + 3)
"""Not 0 while the host has to make room for an earlier call."""
COUNTS = len(COUNTERS) + 4
NOT_FULL = 0x7FFFFFFFFFFFFFFF
"""FULL_FROM while there is room."""

# Results, int64, in memory of the host; the first COUNTS are the counters.
STATUS = wp.constant(COUNTS)
CROWDS = wp.constant(COUNTS + 1)
"""Buckets that are too full for the device. Then of each of MOST_CROWDS its first event and their number."""
MOST_CROWDS = 8
OFFSETS = wp.constant(COUNTS + 2 + 2 * MOST_CROWDS)
"""From here on: where the events of each environment begin, and where the last one's end."""

DONE, OUTGROWN, CROWDED, SKIPPED = 0, 1, 2, 3
"""Status: events in order; no room in the list; a bucket is too full; nothing done, for an earlier call's sake."""
