"""Sensors of environments that cannot share one: their parameters differ, or they were reset at different times."""
