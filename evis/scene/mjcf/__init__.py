"""Reads MuJoCo models (MJCF, URDF) as parts of a scene. Imported only for scenes with dynamics."""
