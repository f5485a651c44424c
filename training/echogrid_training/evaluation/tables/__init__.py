"""The pages and pictures that the figures on simulated drives are written to."""
