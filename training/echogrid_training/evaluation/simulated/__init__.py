"""Figures on simulated drives, cell by cell beside their truth."""
