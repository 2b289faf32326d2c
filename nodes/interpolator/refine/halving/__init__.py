"""Halves the intervals between two samples of a pixel until ln I is straight between samples.

`check_kernels.py` makes samples of the requests, and lists the intervals beside them (`request_interval_kernels.py`) in
which ln I is otherwise than the keyframes told. `split_kernels.py` makes samples of the middles of these, and lists the
halves that are still bent. `interval_kernels.py` holds the list.
"""
