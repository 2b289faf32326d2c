"""Runs one process of a graph.

`__main__.py` is its life from start to end, `control.py` its wire to the supervisor, `parent_death.py` ends it with its
launcher, `thread_failures.py` notes what its threads raise, and `garbage_collection.py` holds Python's collector back
while it gets ready.
"""
