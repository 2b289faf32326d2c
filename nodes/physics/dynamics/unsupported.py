"""What MuJoCo Warp says no to."""


class Unsupported(Exception):
    """Is raised for what MuJoCo Warp cannot take; its text says what."""
