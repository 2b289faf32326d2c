"""Defines the interface of camera drivers to the node: the driver itself, its settings, its readings as messages."""
