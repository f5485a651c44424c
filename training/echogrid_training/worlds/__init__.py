"""Whole worlds to drive in: a town with its traffic and the way of the ego car."""
