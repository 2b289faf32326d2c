"""Schedules the sensor's work on a CPU."""
