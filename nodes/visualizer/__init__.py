"""The live view of a graph as a web page."""
