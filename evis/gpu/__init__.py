"""Holds what nodes share that compute with Warp: recorded launches, and kernels that several of them call."""
