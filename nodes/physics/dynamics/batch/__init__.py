"""Takes the steps of many environments of a MuJoCo model at once: on MuJoCo's threads, or by MuJoCo Warp."""
