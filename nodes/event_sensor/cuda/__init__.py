"""The event sensor's CUDA path: frames and events stay on the device, and a call launches one recorded graph."""
