"""Groups the commands on this machine: what it can do, its cameras, how fast and how exact it is."""
