"""Reads ROS 1 bags and ROS 2's SQLite bags; MCAP is in evis/bag."""
