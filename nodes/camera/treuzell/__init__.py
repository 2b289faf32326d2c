"""Drives cameras whose boards speak the Treuzell protocol: Prophesee EVK3 and EVK4, CenturyArks SilkyEvCam."""
