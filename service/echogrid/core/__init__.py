"""Arithmetic on numpy arrays: no clock, socket, file, thread or log. Time arrives inside the data."""
