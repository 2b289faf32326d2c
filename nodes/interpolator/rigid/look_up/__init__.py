"""Surface points looked up in the keyframes of a gap."""
