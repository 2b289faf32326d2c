"""Reads ROS 1 bags and ROS 2's SQLite bags; MCAP is in evis/bag.

`recording.py` makes events of the messages of one topic (`messages.py`), which `rosbag1.py` and `db3.py` take from
their containers.
"""
