"""Faults put into a recorded drive at random times, and what the service makes of them."""
