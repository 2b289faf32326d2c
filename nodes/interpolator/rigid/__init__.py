"""Implements method `rigid`: exact geometry at every sub-frame, shading taken from the keyframes.

The way of the data through a gap, which `method.py` leads and `portions.py` goes with one portion of the sub-frames
after the other; `layout.py` has its options and sizes:

1. Poses: `placement.py` computes them at the sub-frames, of prescribed motion by `evis/scene/prescribed_batch.py`;
   `slots.py` brings them to the device.
2. Keyframes: `keyframes.py` holds A and B as `keyframe_kernels.py` prepares them: ln I, patches and inverse distances.
   `patches.py` divides surfaces into patches, whose shading has no step inside, and `patch_kernels.py` reads them.
3. Visibility: the renderer's raster draws the sub-frames.
4. Samples: `sampling.py` plans by `plan_kernels.py`, from how far bodies move (`body_motion_kernels.py`), at which
   sub-frames a pixel is looked up, and at which it lies on a line between two that are.
5. Reprojection: `reprojection.py` looks the points up in both keyframes (`look_up/`), and has those shaded that neither
   shows, or both show differently.
"""

from nodes.interpolator.rigid.layout import RigidOptions
from nodes.interpolator.rigid.method import Rigid

__all__ = ["Rigid", "RigidOptions"]
