"""Which lines of a text are frames? Formats of lines, and how many lines are parsed at once."""
