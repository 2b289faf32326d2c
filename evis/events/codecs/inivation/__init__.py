"""iniVation's cameras: DAVIS, DVXplorer, DVXplorer Mini, DVS128."""
