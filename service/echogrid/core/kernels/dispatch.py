"""Which of the two runs: the compiled loops where they are there, else numpy. The one place that decides it.

`loops` is the one or the other: they have the same functions and give the same bits. ECHOGRID_KERNELS=numpy takes numpy in any case.
Loops that were built from other sources than those beside them (a checkout that was renewed without `make`) are not taken, with a warning.
"""

from __future__ import annotations

import os
import warnings
import zlib
from typing import TYPE_CHECKING

from echogrid.core.kernels import reference


def _of_these_sources(module: object) -> bool:
    """As hatch_build.py builds it; where no sources lie beside it, there is nothing that it could differ from."""
    # Without pathlib, which core does not import.
    folder = os.path.dirname(__file__)  # noqa: PTH120
    crc, names = 0, sorted(name for name in os.listdir(folder) if name.endswith((".c", ".h")))  # noqa: PTH208
    for name in names:
        with open(os.path.join(folder, name), "rb") as file:  # noqa: PTH118, PTH123
            crc = zlib.crc32(file.read(), crc)
    return not names or getattr(module, "_built_from", None) == crc


WHY = "numpy, slower: "
if TYPE_CHECKING:
    loops = reference
else:
    loops = reference
    if os.environ.get("ECHOGRID_KERNELS") == "numpy":
        WHY += "as ECHOGRID_KERNELS says"
    else:
        try:
            from echogrid.core.kernels import compiled

            if _of_these_sources(compiled):
                loops, WHY = compiled, "compiled"
            else:
                WHY += f"{compiled.__file__} was built from other sources than those beside it: run make or python hatch_build.py"
                warnings.warn(WHY, RuntimeWarning, stacklevel=2)
        except ImportError as error:
            WHY += f"{error}: there was no C compiler at installation, or it was on another kind of machine"
COMPILED = loops is not reference
