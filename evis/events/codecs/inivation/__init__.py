"""Decodes and encodes the words of iniVation's cameras: DAVIS, DVXplorer, DVXplorer Mini, DVS128."""
