"""Which configuration could read a recording that none was written for? Signals by name, cycles by counting, mounts by Doppler."""
