"""Commands on this machine: what it can do, its cameras, how fast and how exact it is."""
