"""Chooses how a scene is run (`interpolator:=auto`), by measuring cost and error of every candidate.

`launch.py` is what the planner asks. `setting.py` lists the candidates; the first stage, `probe.py`, measures parts of
the chain in the scene's `world.py` and predicts from them cost (`cost.py`, `overlap.py`) and error (`error.py`); the
second one, `trial.py`, runs those that matter (`chain.py`); `choice.py` has the rule; `cache.py` keeps what was
measured.
"""
