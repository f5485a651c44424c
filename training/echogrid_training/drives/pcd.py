"""Binary PCD point clouds, as much of the format as nuScenes' radars use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.sources import some

END_OF_HEADER = b"\nDATA binary\n"


def load_pcd(path: Path, wanted: Sequence[str]) -> Floats:
    """Those fields of every point, (N, wanted). A cloud whose first point is NaN is empty: so nuScenes writes it. Raises EchogridError."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
    header, end, body = content.partition(END_OF_HEADER)
    if not end:
        raise EchogridError(f"{path}: has no line 'DATA binary', expected a binary PCD file")
    lines = [line.split() for line in header.decode("ascii", "replace").splitlines()]
    entries = {words[0]: words[1:] for words in lines if words}
    try:
        names, kinds, sizes = entries["FIELDS"], entries["TYPE"], entries["SIZE"]
        layout = np.dtype([(name, f"<{kind.lower()}{size}") for name, kind, size in zip(names, kinds, sizes, strict=True)])
        count = int(entries["POINTS"][0])
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise EchogridError(f"{path}: its PCD header is not understood: {error}") from error
    missing = [name for name in wanted if name not in names]
    if missing:
        raise EchogridError(f"{path}: has no field '{missing[0]}', found {some(names)}")
    if any(number != "1" for number in entries.get("COUNT", [])) or len(body) < count * layout.itemsize:
        raise EchogridError(f"{path}: holds {len(body)} bytes of points, expected {count} points of {layout.itemsize} bytes")
    points = np.frombuffer(body, dtype=layout, count=count)
    columns = np.stack([points[name].astype(np.float64) for name in wanted], axis=-1)
    return columns[:0] if count and np.isnan(columns[0]).any() else columns
