"""`echogrid`, and `python -m echogrid`."""

import os
import signal
import sys
from itertools import pairwise


def run() -> None:
    """The program; what a signal does while it is loading, which takes a third of a second, is said before that."""
    words = [word for before, word in pairwise(sys.argv) if not word.startswith("-") and before != "--log-level"]
    if words[:1] == ["run"]:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a service that starts is about to read its configuration
        signal.signal(signal.SIGTERM, lambda *_: os._exit(0))  # a container's first process would not hear it; nothing is open yet
    try:
        from echogrid.cli import main
    except KeyboardInterrupt:
        sys.exit(130)
    main()


if __name__ == "__main__":
    run()
