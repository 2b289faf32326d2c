"""Kernels against what their device can do: bytes and operations counted where they are done, rates measured."""
