"""Defines what every camera driver offers to the node: the driver itself, its settings, its readings as messages."""
