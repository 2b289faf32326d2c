"""Chooses which things get a box of their own: instances or whole bodies, of all classes or of some."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.config.suggestions import nearest
from msgs.camera import CameraInfo

OF = ("instance", "body")


def groups(info: CameraInfo, of: str, classes: Sequence[str] | None) -> np.ndarray:
    """Finds for each instance id, int32 [N], the id that its box has; 0 = it has none, as the background.

    Args:
        info: of the camera, with the body and the class of every instance.
        of: one of OF. The box of a body has the id of the first of its instances that get one; what stands in the world
            itself is no body, and has a box for each instance.
        classes: names of those that get boxes; None = all.

    Raises ValueError for a class that there is not, and for an info without classes.
    """
    kept = np.ones(len(info.instance_bodies), bool)
    if classes is not None:
        if info.semantic is None:
            raise ValueError("the camera's info has no classes; leave box_classes out")
        for name in classes:
            if name not in info.classes[1:]:
                raise ValueError(f"box_classes: there is no class '{name}'; {nearest(name, info.classes[1:])}")
        kept = np.isin(info.semantic, [info.classes.index(name) for name in classes])
    kept[:1] = False
    found = np.where(kept, np.arange(len(kept)), 0)
    if of == "body":
        first: dict[str, int] = {}
        for number in np.flatnonzero(kept).tolist():
            if body := info.instance_bodies[number]:
                found[number] = first.setdefault(body, number)
    return found.astype(np.int32)
