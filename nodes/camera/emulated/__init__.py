"""Emulates USB cameras as pyusb sees them, so that the drivers run unchanged without hardware."""
