"""Reads AEDAT 2, 3.1 and 4, writes AEDAT 4.

`aedat2.py` reads version 2, with frames and samples of a DAVIS by `aedat2_davis.py`; `aedat3.py` reads version 3.1.
`aedat4.py` reads version 4 and takes its packets apart with `aedat4_packets.py`; `aedat4_writer.py` writes it.
`flatbuffer.py` reads the flatbuffers of version 4, `flat_builder.py` writes them.
"""

FAMILY = "AEDAT 1.0, 2.0, 3.1 and 4"
"""How the formats are named together, where a file is none of those that are known."""
