"""Where the car is: poses, arcs, dead reckoning from wheels and yaw rate."""
