"""Puts the states of environments after their steps together to the motion between two stamps."""
