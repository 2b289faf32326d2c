"""Compiles a MuJoCo or URDF file to a model, and says what is wrong with one."""
