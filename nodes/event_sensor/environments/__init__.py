"""Makes the sensors of a node's environments, and senses those that cannot share one.

`sensor_maker.py` makes one for all where it can. Where their parameters differ `separate.py` has one for each, and
`reset_groups.py` one for each group of environments that were reset at the same time.
"""
