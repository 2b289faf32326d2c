"""Joins nodes to a graph: their topics and devices, what is left out, their order, and which of them wait."""
