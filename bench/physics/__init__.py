"""Error against run time of the dynamics: cases with a known course, every integrator and time step, failures kept."""
