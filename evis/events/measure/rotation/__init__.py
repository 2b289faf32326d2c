"""Measures rotation seen in events: whether something turns, how fast, about which pivot and in which plane."""
