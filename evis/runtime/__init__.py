"""Runs nodes: their interface, the plan, and what calls them in a process.

The way of a message through a process:

1. `plan.py` says which nodes, topics and processes there are; `process/` starts a process of it.
2. `executor.py` makes the nodes (`hosting/`) and runs the process: it takes messages from the bus where their nodes can
   take them.
3. `scheduler.py` calls the nodes whose inputs are there, paced by `pacing.py` where the wall clock counts.
4. A node (`node.py`) publishes through `outputs.py`, and `delivery.py` hands the message to the nodes of the same
   process and to the bus. What it has declared (`declaration.py`) a launch has read before.

`clock.py` computes stamps; `profile.py` measures where time goes, with `workers.py` for threads, and `telemetry.py`
publishes it. `tap.py` lets a node read a topic lossily, `outside/` lets programs outside of the graph give messages.
`wakeup.py` ends the executor's wait.
"""
