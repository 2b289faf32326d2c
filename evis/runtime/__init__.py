"""Runs nodes: the node's interface, the plan, the executor of a process, joins, delivery, clocks, telemetry."""
