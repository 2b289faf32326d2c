"""Assigns left and right of a stereo pair, as DSEC and MVSEC name their cameras."""

from __future__ import annotations

from evis.dataset.layouts import LayoutError
from msgs.camera import CameraInfo

SIDES = ("left", "right")


def sides(cameras: dict[str, CameraInfo], name: str) -> dict[str, str]:
    """Returns the side of each camera. Raises LayoutError unless they are one camera, or a stereo pair."""
    others = list(cameras)[1:]
    if len(others) > 1 or any(not cameras[other].baseline > 0 for other in others):
        raise LayoutError(
            f"DSEC and MVSEC hold one camera, or a left and a right one of a stereo rig; {name} has "
            f"{', '.join(cameras)}: take one of them, or the layout npz"
        )
    return dict(zip(cameras, SIDES))
