"""Turns a launch file and its arguments into the plan of a graph.

`target.py` finds the launch file and the scene that a user names, `files.py` reads it with its includes, `arguments.py`
and `node_arguments.py` give its arguments values, and `expand.py` makes a flat list of nodes. The room `graph/` joins
these by topics and decides what runs, where and in which order; `planner.py` puts the plan together, and
`resolved_file.py` writes it as a launch file. `attach.py` adds a node to a graph that runs already.
"""
