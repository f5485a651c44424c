"""The running service: which thread does what."""
