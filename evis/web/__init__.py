"""Serves a node's page or socket to programs that nobody has vetted.

`address.py` binds the socket and says by which names and with which token it may be reached. `server.py` runs an
aiohttp application on a thread of its own: `gate.py` limits its connections, `guard.py` refuses requests under a
foreign name, `weblog.py` takes what the libraries log, and `notices.py` hands counts and lines to the node. On the
node's own thread `taps_on_demand.py` reads of the graph what somebody looks at.
"""
