"""What the detections say about the cells around the car: rasters, history, the analytic inverse sensor model."""
