"""The environment share: the messages of some of the environments, for the nodes of one device."""
