"""Defines what camera drivers and the node have in common.

`driver.py` is the interface of a driver and what it gives, `settings.py` its settings with units and ranges,
`messages.py` the bus's messages of a reading, `elapsed.py` the device time over several connections.
"""
