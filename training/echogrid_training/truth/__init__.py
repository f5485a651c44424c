"""What is truly there: the map that a lidar makes along the true path, and the service's map beside it."""
