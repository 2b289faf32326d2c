"""Exports single topics of a bag as files of their own.

`topics.py` chooses the format, and `source.py` gives the messages. Files: events as `evis.events` writes them
(`event_files.py`), archives of arrays (`frames.py`, `labels.py`, `trajectory.py`, and `arrays.py` for all else).
Folders of pictures: keyframes (`keyframes.py`) and labels (`label_images.py`) by `exr.py`, images (`png.py`), and
labels as whole numbers (`label_pngs.py`, `flow_codes.py`).
"""
