"""Reads and writes HDF5 in the layouts of Prophesee, DSEC, TUM-VIE, MVSEC and others.

`reader.py` finds the layout in `layouts.py` and reads datasets through `table.py`, of a cut file by way of `cut.py`;
`writer.py` writes Prophesee's, `dsec_writer.py` DSEC's, by `dsec_events.py` and its `millisecond_index.py`, which data
sets use too. Prophesee's compression ECF: `ecf_layout.py` describes it, `ecf.py` decodes and encodes it,
`ecf_kernels.py` is the fast decoder.
"""
