"""Frames between keyframes."""
