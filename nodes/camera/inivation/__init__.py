"""Drives iniVation cameras: DAVIS346, DVXplorer and DVXplorer Mini on the FX3 register protocol, and the DVS128.

`fx3.py` has the register protocol, on which `davis346.py` and `dvxplorer.py` stand (for a Micro with the registers of
`dvxplorer_micro.py`); `dvs128.py` has a protocol of its own.
"""
