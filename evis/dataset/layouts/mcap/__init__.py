"""Writes and reads bags of ROS 2 messages."""
