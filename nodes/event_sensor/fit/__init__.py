"""Fits the sensor's parameters to a real recording by its statistics, with a scene that is estimated from it."""
