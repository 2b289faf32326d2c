"""Implements what the readers of event files share.

`block_recording.py` cuts blocks of events in time, for most formats; `record_file.py` stands on it for files of records
of one size, and `bisection.py` finds a time in a file. What may be damaged, cut or hostile: `decompress.py`,
`zip_archive.py`, `header_lines.py` (a header that is cut), `zero_tail.py` (a file that a crash has filled with zeros),
`forked_trial.py` (libraries that crash). `unpacked_file.py` is where unpacked data go.
"""
