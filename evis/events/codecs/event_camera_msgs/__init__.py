"""Decodes and encodes payloads of ROS 2's event_camera_msgs/EventPacket."""
