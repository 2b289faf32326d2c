"""Measures the graph as processes: whole runs, the bus, bags, a camera on an emulated USB."""
