"""Drives as files: simulated, imported, written as CAN logs, cut into samples."""
