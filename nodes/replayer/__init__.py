"""Republishes the messages of a bag on their topics.

`choice.py` chooses the topics, `node.py` publishes their messages in order, and `descriptions.py` knows which
CameraInfo holds where a replay begins.

Files and formats are evis/bag's.
"""
