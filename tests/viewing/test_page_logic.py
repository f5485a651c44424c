"""The page's own code, without a browser: it understands the server's frames, and its eye is where it says."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE

from echogrid.viewing import wire
from echogrid.viewing.canvas import Canvas
from echogrid.viewing.server import page_files
from echogrid.viewing.wire import Kind, Plane

PAGE = ROOT / "service" / "echogrid" / "viewing" / "page"
NODE = shutil.which("node")
MOST_BYTES = 300 << 10


def test_the_page_is_small_and_takes_nothing_from_elsewhere() -> None:
    files = page_files()
    assert sum(len(body) for path, body in files.items() if path != "/") < MOST_BYTES
    assert not [
        path for path, body in files.items() if b"https://" in body or b"http://" in body.replace(b"http://www.w3.org/2000/svg", b"")
    ]


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_page_decodes_what_python_encodes() -> None:
    random, canvas = np.random.default_rng(0), Canvas()
    cells = random.integers(-1, 101, (50, 70)).astype(np.int8)
    frames = wire.blocks(Plane.OCCUPANCY, canvas.put(Plane.OCCUPANCY, -20, 100, cells))
    frames += wire.blocks(Plane.SOURCE, canvas.put(Plane.SOURCE, -20, 100, np.where(cells < 0, 0, 2)))
    frames += wire.blocks(Plane.SEEN, canvas.put(Plane.SEEN, -20, 100, np.full(cells.shape, 1_700_000_000)))
    places = np.array([[1.5, -2.0], [3.25, 4.0], [0.0, 1e3]], np.float32)
    stamp_ns = 1_700_000_000_123_456_789
    frames += [
        wire.document(Kind.HELLO, {"name": "ä", "cell": 0.25}),
        wire.reset(),
        wire.pose(stamp_ns, 1.0, -2.0, 3.0, -4.0, 0.5),
        wire.points(stamp_ns, places, np.array([0, 3, 255], np.uint8), np.array([0, 1, 2], np.uint8)),
        wire.trail([(0.5, 1.5), (2.5, 3.5)], true=True),
    ]
    asked = [(100.5 * 0.25, -19.5 * 0.25), (169.5 * 0.25, 29.5 * 0.25), (170.5 * 0.25, 0.0), (1e4, 1e4)]
    said = _node(frames, asked)
    hello, reset, pose, points, trail = said["told"]
    assert hello == {"kind": 1, "name": "ä", "cell": 0.25}
    assert reset == {"kind": 2}
    assert pose == {"kind": 4, "stamp": pytest.approx(stamp_ns * 1e-9, abs=2e-6), "x": 1, "y": -2, "yaw": 3, "speed": -4, "yawRate": 0.5}
    assert (points["places"], points["radars"], points["verdicts"]) == (places.ravel().tolist(), [0, 3, 255], [0, 1, 2])
    assert (trail["true"], trail["places"]) == (True, [0.5, 1.5, 2.5, 3.5])
    assert said["counts"] == {"known": int((cells >= 0).sum()), "occupied": int((cells >= 50).sum())}
    assert said["seen"] == [1_700_000_000, 1_700_000_000]
    known = {"source": 2, "seen": 1_700_000_000, "truth": -1}
    expected = [{"percent": int(cell), **known, "source": 0 if cell < 0 else 2} for cell in (cells[0, 0], cells[-1, -1])]
    assert said["asked"][:2] == expected
    assert [one["percent"] for one in said["asked"][2:]] == [-1, -1]
    assert said["bounds"] == [0, -32, 64, 32]


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_eye_is_where_it_says() -> None:
    """To metres and back; what is under the pointer stays there; what is drawn at a place is drawn at its pixel."""
    said = _node([], [])
    for look in said["looks"]:
        assert look["back"] == pytest.approx([look["px"], look["py"]], abs=1e-6)
        assert look["stays"] == pytest.approx(look["world"], abs=1e-6)
        assert look["drawn"] == pytest.approx([look["px"], look["py"]], abs=1e-6)
    free, occupied, even, unknown, later = np.array(said["pixels"]).reshape(5, 4).tolist()
    assert free == [255, 255, 255, 255]
    assert max(occupied[:3]) < 40
    assert max(occupied[:3]) < min(even[:3]) < 200
    assert unknown[3] == later[3] == 0  # the last one was seen after the time up to which cells are shown


def _node(frames: list[bytes], asked: list[tuple[float, float]]) -> dict[str, object]:
    script = Path(__file__).with_name("page.test.mjs")
    data = b"".join(struct.pack("<I", len(frame)) + frame for frame in frames)
    command = [str(NODE), str(script), str(PAGE), json.dumps(asked)]
    done = subprocess.run(command, input=data, capture_output=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return json.loads(done.stdout)
