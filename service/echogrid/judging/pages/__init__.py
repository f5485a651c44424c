"""A check as a page: plots in SVG, and what was found."""
