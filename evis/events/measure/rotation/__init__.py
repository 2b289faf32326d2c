"""Measures rotation seen in events: whether something turns, how fast, about which pivot and in which plane.

`rotation.py` measures a stretch of a stream:

1. `periodicity.py` finds candidate speeds by a Fourier transform along time.
2. `pivot.py` finds where and in which plane (`plane.py`) something turns.
3. `tracking.py` follows the speed by histograms of angle (`polar.py`), and `alignment.py` refines it by the events
   themselves.
4. `coherence.py` checks that what turns stays the same pattern.

`merge.py` puts stretches together.
"""
