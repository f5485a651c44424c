"""How the map is kept on disk, tile by tile."""
