"""The composed graph of a scene or launch file, held in one Python object and stepped by the caller."""
