"""Which nodes a graph has and how they are joined: topics, devices, what is left out, order, what waits for what."""
