"""Follows environments that begin anew at different times.

`resets.py` finds what a reset asks for, `episodes.py` counts, `environments.py` moves those that were reset together by
an engine, and joins what these give; `told_together.py` puts what is told of several into one line.
"""
