"""The audit node: an error bar on a run, from a few pixels that are also computed by brute force."""
