"""Records topics into a bag.

`node.py` receives messages and hands them to a thread (`handover.py`), which writes them by `recorder.py`, with small
pictures of keyframes (`preview.py`) and, at the end, how the run went (`outcome.py`). Files and formats are evis/bag's.
"""
