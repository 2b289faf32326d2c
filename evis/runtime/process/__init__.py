"""Runs one process of a graph: its life from start to end, its wire to the supervisor, and how it ends with that."""
