"""Senses environments that cannot share a sensor: their parameters differ (`separate.py`), or they were reset at
different times (`reset_groups.py`)."""
