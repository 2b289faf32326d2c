"""Computes closed-form motion of many bodies, and of many keyframes ahead."""
