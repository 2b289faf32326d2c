"""Holds the nodes of one process.

`wiring.py` makes a `host.py` for each node of the plan, with its queues, publishers and subscribers; `join.py` joins
its inputs by stamp, and `node_call.py` charges the time of a call to the node and names it in errors. `taps.py` holds
the topics that nodes read lossily while the graph runs, and `seeds.py` asks nodes whether environments can have other
seeds.
"""
