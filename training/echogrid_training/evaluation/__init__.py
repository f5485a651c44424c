"""How good a map is: on simulated drives and on recorded ones."""
