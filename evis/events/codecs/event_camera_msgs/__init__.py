"""Decodes and encodes payloads of ROS 2's event_camera_msgs/EventPacket.

`payload.py` is what they share: every message stands alone and has a time base. `libcaer.py`, `libcaer_cmp.py`
(`libcaer_cmp_kernels.py`) and `trigger.py` have an encoding each, `mono_codec.py` that of `mono.py`.
"""
