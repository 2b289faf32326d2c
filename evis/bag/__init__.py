"""Reads and writes bags: MCAP files whose messages ROS 2 tools can read and that give every message back bit for bit.

The way of a message:

1. `selection.py` says which topics are recorded; `attach.py` records a running graph by taps.
2. `writer.py` splits it by environments (`environments.py`), converts it to ROS 2 messages (`ros/`) and puts these into
   the container (`mcap/`); `threads.py` share the work. `preview.py` makes the 8-bit image of a keyframe.
3. `reader.py` takes chunks out of the container, as many at once as `unpacked_chunks.py` lets it, puts them in order
   and makes the message again; `decoded.py` decodes a sensor's own words in it.

`info.py` describes a bag, `recover.py` makes a torn one whole, `export/` writes single topics to files, and
`recording.py` reads events of any MCAP file as a recording.

Nothing here is imported before it is used, so that a graph without a bag loads none of it.
"""


class BagError(ValueError):
    """Reports that a bag cannot be read or written; the text names the file, what is wrong and the remedy."""
