"""Dead reckoning's scores against poses whose errors are known, and the table of a simulated drive."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import pytest

from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.errors import EchogridError
from echogrid.logs.drive import Truth
from echogrid_training.evaluation import motion
from echogrid_training.evaluation.recorded.reckoning import Reckoned, score

TIME = np.arange(0.0, 20.0, 0.05)
STAMPS = (1_700_000_000 + TIME * 1e9).astype(np.int64)
TRUE = np.stack((8.0 * TIME, 6.0 * np.sin(TIME / 4), np.arctan2(1.5 * np.cos(TIME / 4), 8.0)), axis=1)
CERTAIN = np.repeat(np.diag((0.25, 1.0, 0.01))[None], len(TIME), axis=0)


def reckoned(poses: np.ndarray) -> Reckoned:
    return Reckoned(STAMPS, poses, CERTAIN, {}, ErrorFilter(()).keep())


def seen_from(poses: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    """The same way in another frame."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.stack((c * poses[:, 0] - s * poses[:, 1] + x, s * poses[:, 0] + c * poses[:, 1] + y, poses[:, 2] + yaw), axis=1)


def test_where_the_frames_lie_is_no_error() -> None:
    one = score(reckoned(seen_from(TRUE, 50.0, -7.0, 2.0)), Truth(STAMPS, TRUE, None))
    assert max(one.off, one.later_off, one.place, one.heading) < 1e-9
    assert one.way == pytest.approx(np.hypot(*np.diff(TRUE[:, :2], axis=0).T).sum())


def test_a_scale_is_off_by_its_share_of_the_spread() -> None:
    """Scaled about its mean, a way is off by the scale times the spread of its places."""
    spread = math.sqrt(TRUE[:, 0].var() + TRUE[:, 1].var())
    one = score(reckoned(TRUE * (1.02, 1.02, 1.0)), Truth(STAMPS, TRUE, None))
    assert one.off == pytest.approx(0.02 * spread, rel=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 1.3])
def test_errors_at_the_end_are_told_in_claimed_sigmas(yaw: float) -> None:
    """Half a metre ahead is one sigma, wherever the frame of the true poses points; a tenth of a rad is one as well."""
    drifted = TRUE.copy()
    drifted[-1] -= (0.5, 0.0, 0.1)
    start = TRUE[0, 2]
    one = score(reckoned(drifted), Truth(STAMPS, seen_from(TRUE, 1.0, 2.0, yaw), None))
    c, s = math.cos(start), math.sin(start)
    ahead = np.array((0.5 * c, -0.5 * s))  # in the frame of the first pose
    turned = np.array(((c, s), (-s, c))) @ CERTAIN[0][:2, :2] @ np.array(((c, s), (-s, c))).T
    assert one.place == pytest.approx(ahead @ np.linalg.solve(turned, ahead), rel=1e-6)
    assert one.heading == pytest.approx(1.0, rel=1e-6)


def test_other_times_are_refused() -> None:
    with pytest.raises(EchogridError, match="no time in common"):
        score(reckoned(TRUE), Truth(STAMPS + 10**12, TRUE, None))


def test_a_drive_gives_a_row_and_a_summary(room_drive: Path) -> None:
    table = motion.run(argparse.Namespace(drives=[room_drive, room_drive], one_car=True))
    rows = [line for line in table.splitlines()[2:] if line.startswith(f"| {room_drive.name} ")]  # below the head
    assert len(rows) == 2
    assert all(row.count("|") == len(motion.HEADS) + 1 for row in rows)
    assert "Learned / raw: median" in table


def test_a_drive_without_true_poses_is_refused(room_drive: Path, tmp_path: Path) -> None:
    for name in ("can.log.gz", "echogrid.toml"):
        (tmp_path / name).write_bytes((room_drive / name).read_bytes())
    with pytest.raises(EchogridError, match="has no truth.npz"):
        motion.run(argparse.Namespace(drives=[tmp_path], one_car=False))
