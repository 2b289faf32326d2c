"""Measures the ways to make frames between keyframes: error against run time, speed, hard cases."""
