"""Computes what comes before the threshold: defocus and the photoreceptor; `optics.py` applies both.

`defocus.py` blurs by `defocus_kernels.py` (`defocus.h`), slopes too (`slope_kernels.py`). `photoreceptor.py` is the low
pass, by `photoreceptor_kernels.py` and, of many pixels at a time, `photoreceptor_simd_kernels.py`
(`photoreceptor_simd.h`). `trace.py`, by `trace_kernels.py` and `trace_line_kernels.py`, gives its output between the
samples too. `photoreceptor_noise.py` and `photoreceptor_noise_kernels.py` add its noise, the process of
`filtered_noise_kernels.py`.
"""
