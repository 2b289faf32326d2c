"""What nodes stand on: the bus, the node runtime, launch, geometry, scenes, streams, bags, the command line."""
