"""Bags of ROS 2 messages."""
