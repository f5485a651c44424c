"""Which of the two runs: the compiled loops where they are there, else numpy. The one place that decides it.

`loops` is the one or the other: they have the same functions and give the same bits. ECHOGRID_KERNELS=numpy takes numpy in any case.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from echogrid.core.kernels import reference

WHY = "numpy, slower: "
if TYPE_CHECKING:
    loops = reference
else:
    loops = reference
    if os.environ.get("ECHOGRID_KERNELS") == "numpy":
        WHY += "as ECHOGRID_KERNELS says"
    else:
        try:
            from echogrid.core.kernels import compiled as loops

            WHY = "compiled"
        except ImportError as error:
            WHY += f"{error}: there was no C compiler at installation, or it was on another kind of machine"
COMPILED = loops is not reference
