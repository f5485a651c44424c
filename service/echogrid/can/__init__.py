"""How frames of a CAN bus become scans and ego motion: buses, DBC files, profiles, decoding."""
