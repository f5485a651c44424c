"""How a drive is recorded and watched: MCAP files and the live view of Foxglove."""
