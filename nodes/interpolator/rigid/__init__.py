"""Implements method `rigid`: exact geometry at every sub-frame, shading taken from the keyframes."""

from nodes.interpolator.rigid.layout import RigidOptions
from nodes.interpolator.rigid.method import Rigid

__all__ = ["Rigid", "RigidOptions"]
