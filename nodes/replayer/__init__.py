"""Republishes a bag.

`choice.py` says which topics are played, `node.py` publishes their messages, stamp by stamp and at the pace asked for,
and `descriptions.py` those CameraInfo that came before the part that is played. Files and formats are evis/bag's.
"""
