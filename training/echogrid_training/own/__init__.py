"""What your own drives say: how good the map is on your car, and a model that learned from them."""
