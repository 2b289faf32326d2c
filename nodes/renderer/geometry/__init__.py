"""Holds a scene's triangles and body poses as flat arrays on the device.

`triangles.py` flattens the meshes once; for every image `poses.py` checks the poses of bodies, `pose_upload.py` sends
what has changed, and `pose_kernels.py` computes where instances are in the camera's frame.
"""
