"""Decodes and encodes the words of iniVation's cameras: DAVIS, DVXplorer, DVXplorer Mini, DVS128.

`davis.py`, `dvxplorer.py`, `dvxplorer_mini.py` and `dvs128.py` say what the words are, and have the decoder by numpy
and the encoder; their kernels are `davis_kernels.py`, `dvxplorer_kernels.py`, `dvxplorer_mini_kernels.py` and
`dvs128_kernels.py`. DAVIS and DVXplorer share `words.py` with `word_kernels.py` (time and triggers), `encoder.py`, and
`imu.py` (inertial samples). `davis_frames.py` puts frames together; `dvxplorer_mini_imu.py` decodes samples that come
beside the events.
"""
