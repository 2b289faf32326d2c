"""Describes the ROS 2 messages of a bag: CDR, schemas, and which message becomes which."""
