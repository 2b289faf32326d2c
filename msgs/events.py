"""Offers the event packet's short import path, for the many users who need nothing else."""

from msgs.camera import EventPacket

__all__ = ["EventPacket"]
