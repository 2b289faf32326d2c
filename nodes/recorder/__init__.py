"""Records topics into a bag.

`node.py` receives messages and counts those it missed; `handover.py` hands them to a thread, in which `recorder.py`
writes them, with previews of keyframes (`preview.py`) and, at the end, how the run went (`outcome.py`).

Files and formats are evis/bag's.
"""
