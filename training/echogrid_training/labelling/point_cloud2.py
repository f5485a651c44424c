"""sensor_msgs/PointCloud2 as drivers of lidars send it: any order of fields, any step, either byte order."""

from __future__ import annotations

import struct

import numpy as np

from echogrid.core.messages import Floats
from echogrid.topics.cdr import aligned, body_of, read, read_header, read_text

KINDS = {7: "f4", 8: "f8"}  # of sensor_msgs/PointField: float32, float64
MOST_FIELDS = 64
_SHAPE = struct.Struct("<III")  # height, width, number of fields
_FIELD = struct.Struct("<IBxxxI")  # offset, datatype, count
_STEPS = struct.Struct("<BxxxIII")  # is_bigendian, point_step, row_step, length of data


def decode_cloud(payload: bytes) -> tuple[int, str, Floats]:
    """Stamp (ns), frame, and points (N, 3) m of those that are finite. Raises ValueError."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    height, width, fields = read(_SHAPE, body, at)
    at += _SHAPE.size
    if fields > MOST_FIELDS:
        raise ValueError(f"a cloud of {fields} fields")
    offsets: dict[str, tuple[int, int]] = {}
    for _ in range(fields):
        name, at = read_text(body, at)
        at = aligned(at, 4)
        offset, kind, _ = read(_FIELD, body, at)
        offsets[name] = (offset, kind)
        at += _FIELD.size
    big_endian, step, row_step, size = read(_STEPS, body, at)
    at += _STEPS.size
    missing = [name for name in "xyz" if name not in offsets]
    if missing:
        raise ValueError(f"a cloud without the field '{missing[0]}', it has {', '.join(offsets) or 'none'}")
    order = ">" if big_endian else "<"
    layout = []
    for name in "xyz":
        offset, kind = offsets[name]
        if kind not in KINDS or offset + int(KINDS[kind][1]) > step:
            raise ValueError(f"a cloud whose field '{name}' is no float within a point's {step} bytes")
        layout.append((offset, np.dtype(order + KINDS[kind])))
    if row_step < width * step or size < height * row_step or len(body) < at + size:
        raise ValueError(f"a cloud of {height} x {width} points of {step} bytes that holds {len(body) - at} bytes")
    rows = np.frombuffer(body[at : at + height * row_step], np.uint8).reshape(height, row_step)[:, : width * step].reshape(-1, step)
    columns = [
        np.ascontiguousarray(rows[:, offset : offset + kind.itemsize]).view(kind).reshape(-1).astype(float) for offset, kind in layout
    ]
    points = np.stack(columns, axis=-1)
    return stamp_ns, frame, points[np.isfinite(points).all(axis=1)]
