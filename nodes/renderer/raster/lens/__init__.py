"""Models the camera: its rays, its lens, and what of the image they cover.

`cameras.py` makes the CameraView of `view_kernels.py`, with the ray of each pixel; `distortion_kernels.py` computes
where a lens shows a direction, and what a triangle covers; `displacement_kernels.py` by how many pixels a point moves.
"""
