"""Drives cameras whose boards speak the Treuzell protocol: Prophesee EVK3 and EVK4, CenturyArks SilkyEvCam.

`camera.py` finds the sensor on a board and sets it up: by commands of `protocol.py`, register sequences of `sensor.py`,
and the settings of `imx636.py` (also Gen4.1), `gen31.py` or `genx320.py`.
"""
