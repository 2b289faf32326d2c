"""Converts words on a wire to events and back: what all codecs share; a folder per maker, its kernels beside."""
