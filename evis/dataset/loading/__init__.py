"""Reads data sets for training: sequences, windows of their events beside labels, batches, streams."""
