"""What is really there, by the lidar of a reference car? Its recordings, its place on the car, and the truth out of both."""
