"""Converts messages to the ROS 2 messages of a bag and back.

`mapping.py` says which message becomes which: `images.py`, `events.py`, `states.py` (by `transforms.py`) and
`lenses.py` convert them, `jsonform.py` writes the rest as JSON. `messages.py` has the ROS messages, in CDR by `cdr.py`,
and `schemas.py` their definitions.
"""
