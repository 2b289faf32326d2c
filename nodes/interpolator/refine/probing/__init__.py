"""How often between two frames everything is looked at, so that nothing thin or fast passes unseen."""
