"""Reads and writes Event Stream (.es) files, as Prophesee ATIS and DVS recordings of several laboratories have them."""
