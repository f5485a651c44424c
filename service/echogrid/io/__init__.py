"""The outside world: CAN frames in, maps out. It has no opinions about maps."""
