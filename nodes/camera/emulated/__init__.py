"""Emulated USB cameras: what pyusb sees of a device, so that the drivers run unchanged without hardware."""
