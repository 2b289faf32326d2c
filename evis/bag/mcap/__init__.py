"""Reads and writes MCAP containers.

`container.py` writes a file, which `claim.py` opens (`path_checks.py` says where that is impossible): it collects
messages in chunks, which `packing.py` compresses and `checksum.py` checks; `background_worker.py` writes large ones in
a thread, `summary.py` holds the index until the end, and `sync.py` brings the file to the disk. `scan.py` finds the
chunks of a file, whole or torn. `marks.py` has the marks of both.
"""
