"""Reads and writes recordings in files: one module per format, found by `evis.events.open_recording`.

`prophesee/` (RAW, DAT), `aedat/`, `hdf5/`, `numpy_files/` (.npz, .npy), `text/`, `es/`, `rosbag/` and `nmnist.py` are
the formats, each with `matches`, `open_file` and, where it is written, `create`; `packed_file.py` unpacks compressed
ones. Readers share `reading/`, writers `file_writer.py`.
"""
