"""Runs nodes: their interface, the plan, the executor of a process, who is called when, clocks, telemetry.

`node.py` is what a node is written against, `plan.py` the graph as evis/launch has resolved it. In each process
(`process/`) an executor (`executor.py`) makes the nodes of its part (`hosting/`), joins their messages by stamp, calls
them in turn (`scheduler.py`), and gives what they publish (`outputs.py`) to nodes of the same process by reference
(`delivery.py`) and to all others by evis/bus. `outside/` lets programs that are no nodes take part.
"""
