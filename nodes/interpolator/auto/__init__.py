"""Chooses how a scene is run (`interpolator:=auto`), by measuring cost and error of every candidate."""
