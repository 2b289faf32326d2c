"""Holds the composed graph of a scene or launch file in one Python object, stepped by the caller."""
