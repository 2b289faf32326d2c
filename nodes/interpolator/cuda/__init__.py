"""The warp on a GPU."""
