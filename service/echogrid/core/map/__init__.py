"""What all updates together say about the world: tiles, the rules of fusion, merging, what changed."""
