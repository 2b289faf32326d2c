"""Draws pictures for people: frames beside events, as an animation or a still."""
