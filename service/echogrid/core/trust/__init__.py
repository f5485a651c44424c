"""Which radars and which ego motion are trusted, and what the state of the map is."""
