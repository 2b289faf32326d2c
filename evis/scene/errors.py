"""Defines what can go wrong while a scene is read."""


class SceneError(ValueError):
    """Says that a scene cannot be loaded. The text names the file, the line where there is one, the key and the
    remedy.
    """
