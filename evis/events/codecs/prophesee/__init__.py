"""Decodes and encodes Prophesee's EVT2, EVT2.1, EVT3 and EVT4.

`evt2.py`, `evt21.py`, `evt3.py` and `evt4.py` say what the words are, and have the decoder by numpy and the encoder;
`evt21_legacy.py` has the other order of words. Their kernels are `evt2_kernels.py` (also of EVT2.1), `evt3_kernels.py`
and `evt4_kernels.py`, with inner loops in C++ that `run_kernels.py` embeds (`evt2_runs.h`, `evt3_runs.h`).
"""
