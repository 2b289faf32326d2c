"""Runs nodes: their interface, the plan, the executor of a process, who is called when, clocks, telemetry."""
