"""From a MuJoCo or URDF file to the compiled model, and what is wrong with one."""
