"""`echogrid`, and `python -m echogrid`."""

import os
import signal
import sys
from itertools import pairwise


def run() -> None:
    """The program; what a signal does while it is loading, which takes a third of a second, is said before that."""
    open_all()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what is open is closed
    words = [word for before, word in pairwise(sys.argv) if not word.startswith("-") and before != "--log-level"]
    if words[:1] == ["run"]:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a service that starts is about to read its configuration
        signal.signal(signal.SIGTERM, lambda *_: os._exit(0))  # a container's first process would not hear it; nothing is open yet
    try:
        from echogrid.cli import main

        main()
    except KeyboardInterrupt:
        ends_so = words[:1] in (["run"], ["view"]) or (words[:1] == ["replay"] and "--publish" in sys.argv)
        sys.exit(0 if ends_so else 130)


def open_all() -> None:
    """What a caller closed, as `>&-` does, leads nowhere: Python has no such file then, and the next one opened would take its place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None and os.open(os.devnull, os.O_RDWR) == number:
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


if __name__ == "__main__":
    run()
