"""Lets programs outside a running graph give messages to its nodes: a controller takes over /action, anyone resets.

`inputs.py` takes their messages by a socket of the node; `controlled_input.py` tracks who controls an input and what
the next step gets.

Packets both ways (evis/bus/links.py) begin with a msgpack map. From outside: {"op": "attach", "topic", "who",
"lockstep", "patience_s"}, {"op": "message", "topic"} with the frames of a message behind it, {"op": "leave"}.
From the node: {"op": "welcome", "lockstep", "offer"}, {"op": "taken", "stamp_ns"} and {"op": "refused", "why"}, one to
each of attach and message; and {"op": "due", "stamp_ns"} where a step waits, {"op": "lost", "why"} where control went.
"""

ANY_STAMP = -(1 << 63)
"""Stamp of an action for whichever step comes next: one that no step has."""
