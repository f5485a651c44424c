"""Who drives, and how: lanes, paces, steering, the ego car, the traffic."""
