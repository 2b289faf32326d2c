"""Computes closed-form motion of many keyframes ahead."""
