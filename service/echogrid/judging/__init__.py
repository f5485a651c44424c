"""What a recording says about its configuration: signs, units, mounts, offsets and losses, from arrays alone."""
