"""Brings topics of a running graph to another host, over TCP with CURVE keys.

The way of a message:

1. `server.py`, beside the graph, reads a topic by a tap, as long as a follower wants it, and sends what it has read to
   followers whose public key (`keys.py`) it was given.
2. `follower.py`, on the other host, connects with its own key, checks every message, and counts what was lost on the
   way.
3. `local_run.py` offers it there by a tap in the private directory of a run whose plan is that of the graph, so that
   whatever reads a running graph reads it.

`protocol.py` has what the two say to each other. A follower wants of a topic what its own readers want: nothing, as
many messages as a viewer, or every one.
"""
