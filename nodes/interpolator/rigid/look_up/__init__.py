"""Looks up surface points in the keyframes of a gap."""
