"""`python -m echogrid`."""

from echogrid.cli import main

main()
