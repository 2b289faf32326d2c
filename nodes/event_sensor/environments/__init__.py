"""Senses environments that cannot share a sensor: their parameters differ, or they were reset at different times."""
