"""Chooses how often all surfaces are drawn between two frames, so that nothing thin or fast passes unseen."""
