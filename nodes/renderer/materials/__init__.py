"""Computes how surfaces reflect: the GGX model (`ggx_kernels.py`) and the tables of its integrals (`ggx.py`)."""
