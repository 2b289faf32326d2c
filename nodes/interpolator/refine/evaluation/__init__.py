"""Evaluates the listed pixels: which surface a pixel shows at an instant, and its radiance there.

`trace_kernels.py` goes through a list, and `visibility_kernels.py` casts the rays: first at what the pixel showed
before and after, then at all else. `evaluator.py` places the scene at the instants of a window, looks up in the
keyframes what rays met, and shades what neither shows; `limb_kernels.py` shades points of outlines.
"""
