"""Exports single topics of a bag as files of their own.

`topics.py` chooses the format: `frames.py`, `labels.py` and `trajectory.py` write arrays; `exr.py` (keyframes),
`png.py` (images), `label_images.py` and `label_pngs.py` (`flow_codes.py`) write folders of images.
"""
