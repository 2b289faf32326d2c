"""Fits the sensor's parameters to a real recording by its statistics, with a scene that is estimated from it.

`fit.py` fits a sensor to recordings. `wheel.py` finds the scene in one, `clip.py` holds both and simulates a sensor
before it; `statistics.py` has what is compared. Noise comes from what stands still (`still.py`), thresholds, bandwidth
and refractory period from what moves (`motion.py`), by the least squares of `search.py`. `report.py`, `plot.py` and
`preset_file.py` write what was found.
"""
