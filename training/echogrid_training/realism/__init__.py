"""How much simulated drives resemble recorded ones."""
