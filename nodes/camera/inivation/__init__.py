"""Drives iniVation cameras: DAVIS346, DVXplorer and DVXplorer Mini on the FX3 register protocol, and the DVS128."""
