"""Figures on recorded drives."""
