"""Turns messages into the arrays of a sensor: their images, several messages as one call, calls under way on a GPU."""
