"""Defines the errors that reading a scene raises."""


class SceneError(ValueError):
    """Says that a scene cannot be loaded. The text names the file, the line where there is one, the key and the
    remedy.
    """
