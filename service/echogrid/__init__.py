"""echogrid: corner radars on CAN in, one dense occupancy map out."""

__version__ = "0.1.0"
