"""The one exception a person is meant to read."""


class EchogridError(Exception):
    """One sentence that names the file, the key or frame, what was found and what was expected.

    The command line prints it without a traceback and exits with `exit_code`.
    """

    exit_code = 1


class NoMapError(EchogridError):
    """A recording could be read, but no map came of it."""

    exit_code = 3
