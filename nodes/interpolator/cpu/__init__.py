"""The warp on a CPU."""
