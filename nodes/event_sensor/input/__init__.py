"""What a sensor is given, before its kernels: frames and further samples as arrays on its device, checked."""
