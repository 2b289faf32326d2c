"""`splat`: the paper's bidirectional motion-vector warp, equations (5) to (7), with a hard z-buffer.

At fraction f = i/K of the gap, B's pixels go back along their motion and A's forward along their own of the gap before:
q_B = p + (1 - f) m_B(p), q_A = p - f m_A(p), at the depth (1 - f) Z_A + f Z_B along the correspondence, Z of the other
keyframe being its nearest pixel there, or the source's own where that is outside or sky. Of B's sources whose bilinear
footprint covers a pixel, those within 1 % of the smallest depth are averaged by their weights; A's fill only where B
has none; a pixel that neither saw takes its nearest background. Frame K is B itself.

On a CPU a serial scatter sums in the order of the sources; on a GPU sums are in whole numbers. Both give the same bytes
every time, and differ from each other by float rounding only.
"""

from __future__ import annotations

import warp as wp

from nodes.interpolator.keyframe import Method
from nodes.interpolator.splat.cpu import SplatCpu


def make_splat(
    height: int,
    width: int,
    envs: int,
    upsampling: int,
    margin: int = 0,
    channels: int = 1,
    device: str = "cpu",
    threads: int = 1,
) -> Method:
    """Makes the warp for keyframes of height x width px, margin included, on a device. upsampling: K. channels: 1 or
    3."""
    if wp.get_device(device).is_cuda:
        from nodes.interpolator.splat.cuda import SplatCuda

        return SplatCuda(height, width, envs, upsampling, margin, channels, device)
    return SplatCpu(height, width, envs, upsampling, margin, channels, threads)
