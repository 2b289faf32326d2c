"""Runs the event sensor on CUDA: frames and events stay on the device, and a call launches one recorded graph."""
