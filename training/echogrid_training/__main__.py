"""`echogrid-train`, and `python -m echogrid_training`, as torchrun starts it."""

import sys

from echogrid.__main__ import open_all


def run() -> None:
    """Ends the program; at Ctrl-C with 130 also while it is loading, which takes a second or two."""
    open_all()
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # python-can would import it: most of a second; library.read_mf4 lets it in
    try:
        from echogrid_training.cli import main

        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    run()
