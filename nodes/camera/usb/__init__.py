"""Handles cameras on USB: finding and opening a device, reading its stream, mapping its clock."""
