"""Renders scene-linear HDR keyframes with exact depth, ids, normals and motion.

The way of the data:

1. `node.py` takes /state and publishes the images, and what `camera_info.py` tells of the camera; `declaration.py` and
   `parameters.py` have what a user may choose, `at_once.py` how many keyframes are computed together, `cores.py` how
   many threads share an image, `poses_before.py` what motion vectors begin from. `renderer.py` renders an image;
   `supersampling.py` one of several samples per pixel; `separate.py` has a renderer for each look of the world.
2. `geometry/` holds triangles, and brings poses into the camera's frame.
3. `raster/` computes primary visibility, a z-buffer, through any lens, and the geometric images from it.
4. `lighting.py` has what is seen shaded by `shading/`, with materials (`materials/`, `textures/`), lights and the sky
   (`lights/`), what is in their way (`shadows/`), and light over several surfaces, if asked for (`paths/`).
"""
