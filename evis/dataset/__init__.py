"""Data sets: labelled sequences in the layouts that training code reads."""
