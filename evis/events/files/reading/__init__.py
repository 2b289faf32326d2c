"""Implements what the readers of event files share: blocks and records, decompression, archives, trials in a forked
process."""
