"""What sensors report of a world: radars, lidar, motion sensors, and how they fail."""
