"""Turns messages into the arrays of a sensor and its events into packets.

`images.py` reads messages, `in_a_row.py` finds those that one call may take, `calls_in_flight.py` keeps the calls that
a GPU works on, and `packets.py` publishes their events.
"""
