"""Cuts messages of all environments to one share of them, for the nodes of one device."""
