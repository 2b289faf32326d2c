"""The nodes of the graph, one folder each."""
