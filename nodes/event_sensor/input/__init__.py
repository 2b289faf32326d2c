"""Prepares the input of a sensor before its kernels: frames and further samples as arrays on its device, checked."""
