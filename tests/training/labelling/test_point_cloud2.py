"""Clouds of any layout: packed by hand, and as our own encoder writes them."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from echogrid.topics.cdr import LITTLE_ENDIAN, encode_header, encode_text, padded
from echogrid.topics.points import Points, encode_points
from echogrid_training.labelling.point_cloud2 import decode_cloud

XYZ = np.random.default_rng(1).normal(0.0, 20.0, (12, 3))


def packed(fields: list[tuple[str, int, int]], step: int, row_step: int, shape: tuple[int, int], data: bytes, big: bool) -> bytes:
    body = encode_header(1_600_000_000_123_456_789, "velodyne") + struct.pack("<III", *shape, len(fields))
    for name, offset, kind in fields:
        body = padded(body + encode_text(name), 4) + struct.pack("<IBxxxI", offset, kind, 1)
    return LITTLE_ENDIAN + body + struct.pack("<BxxxIII", big, step, row_step, len(data)) + data + b"\1"


def test_our_own() -> None:
    stamp, frame, points = decode_cloud(encode_points(Points(17, "lidar", XYZ.astype(np.float32))))
    assert (stamp, frame) == (17, "lidar")
    np.testing.assert_array_equal(points, XYZ.astype(np.float32))


@pytest.mark.parametrize("big", [False, True])
def test_drivers_with_other_fields_steps_and_orders(big: bool) -> None:
    """Intensity first, doubles, z before x, padding behind points and rows, two rows, some points not a number."""
    order = ">" if big else "<"
    kind = np.dtype(
        {
            "names": ["i", "z", "x", "y"],
            "formats": [order + "u2", order + "f8", order + "f4", order + "f8"],
            "offsets": [0, 4, 12, 20],
            "itemsize": 32,
        }
    )
    rows = np.zeros((2, 6), kind)
    for number, name in enumerate("xyz"):
        rows[name] = XYZ[:, number].reshape(2, 6)
    rows["y"][1, 2] = np.nan
    data = b"".join(row.tobytes() + bytes(8) for row in rows)
    fields = [("intensity", 0, 4), ("z", 4, 8), ("x", 12, 7), ("y", 20, 8)]
    stamp, frame, points = decode_cloud(packed(fields, 32, 6 * 32 + 8, (2, 6), data, big))
    assert (stamp, frame) == (1_600_000_000_123_456_789, "velodyne")
    np.testing.assert_allclose(points, np.delete(XYZ, 8, axis=0), rtol=1e-6)


def test_what_is_no_cloud_is_said() -> None:
    fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    data = np.zeros((4, 3), "<f4").tobytes()
    good = packed(fields, 12, 48, (1, 4), data, False)
    assert len(decode_cloud(good)[2]) == 4
    for payload, expected in (
        (packed(fields[:2], 12, 48, (1, 4), data, False), "without the field 'z', it has x, y"),
        (packed([*fields[:2], ("z", 8, 2)], 12, 48, (1, 4), data, False), "field 'z' is no float"),
        (packed(fields, 8, 48, (1, 4), data, False), "field 'z' is no float within a point's 8 bytes"),
        (packed(fields, 12, 48, (1, 5), data, False), "1 x 5 points of 12 bytes"),
    ):
        with pytest.raises(ValueError, match=expected):
            decode_cloud(payload)
    for end in range(len(good) - 1):
        with pytest.raises(ValueError, match="."):
            decode_cloud(good[:end])
