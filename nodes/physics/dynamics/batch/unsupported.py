"""Defines the error of a model that MuJoCo Warp cannot take."""


class Unsupported(Exception):
    """Says what of a model MuJoCo Warp cannot take."""
