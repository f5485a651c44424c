"""How the service holds out: hours of driving without end, and buses that carry too much. `python -m tests.endurance`."""
