"""Steps environments of a MuJoCo model: their start, their steps, what is read of them, and their states as an
interval."""
