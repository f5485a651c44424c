"""How files become CAN frames: a recording of any format, and drive folders."""
