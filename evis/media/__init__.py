"""Frames in, pictures and animations out."""
