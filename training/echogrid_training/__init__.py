"""echogrid-training: drives for echogrid, generated or imported from public recordings, and what trains its network."""

__version__ = "0.1.0"
