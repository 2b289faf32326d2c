"""Holds the nodes of the graph, one folder each."""
