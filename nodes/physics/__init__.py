"""Computes poses and twists of all bodies, prescribed in closed form or by MuJoCo.

From keyframe to keyframe: `node.py`, declared in `declaration.py`, takes the action and asks `environments/` for the
states up to the next stamp. That asks an engine (`engines/`: in closed form, or MuJoCo with `dynamics/`), which gives
an `Interval` (`interval.py`): poses and twists at every sub-step. The node publishes it as a WorldState on /state.
`watchdog.py` and `stiffness.py` tell why motion diverges; `precision/` how exact it is.
"""
