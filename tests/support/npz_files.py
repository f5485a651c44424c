"""Files of arrays with something wrong in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np


def changed(path: Path, **changes: Any) -> Path:
    """A copy of an .npz file with other arrays, or without those that are None."""
    kept = {key: value for key, value in (dict(np.load(path)) | changes).items() if value is not None}
    copy = path.with_stem("changed")
    np.savez(copy, **kept)
    return copy
