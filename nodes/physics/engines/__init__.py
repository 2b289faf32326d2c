"""Moves the bodies of environments that were reset together, from one keyframe stamp to the next.

`engine.py` says what an engine does, and `choice.py` makes those that a run needs: `prescribed.py` has motion in closed
form, `mujoco_engine.py` steps a MuJoCo model (`dynamics/`), and `separate.py` has one for each of environments that do
not move alike.
"""
