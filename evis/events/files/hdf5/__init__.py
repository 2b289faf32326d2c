"""Reads and writes HDF5 in the layouts of Prophesee, DSEC, TUM-VIE, MVSEC and others, with Prophesee's ECF
compression."""
