"""Divides the rate of states: a camera with a keyframe rate of its own gets those of every n-th keyframe."""
