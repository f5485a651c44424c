"""How files become CAN frames: log formats and drive folders."""
