"""`python -m echogrid_training`, as torchrun starts it."""

import sys

from echogrid_training.cli import main

sys.exit(main())
