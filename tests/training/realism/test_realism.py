"""The figures of the comparison on numbers whose answer is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from echogrid.core.messages import RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid_training.realism import figures as realism
from echogrid_training.realism import report
from echogrid_training.recording import Truth


def test_the_robust_sigma_of_normal_numbers_is_their_sigma_whatever_a_few_outliers_say() -> None:
    values = np.random.default_rng(1).normal(0.3, 0.12, 20_000)
    values[:500] = 50.0
    assert realism.spread(values) == pytest.approx(0.12, rel=0.05)
    assert realism.gross_share(values) == pytest.approx(500 / 20_000)


def test_the_true_motion_on_a_circle() -> None:
    t = np.arange(0, 10, 0.02)
    truth = Truth((t * 1e9).astype(np.int64), 20 * np.sin(0.3 * t), 20 * (1 - np.cos(0.3 * t)), 0.3 * t)
    motion = realism.motion_at(truth, 5_000_000_000)
    assert motion == pytest.approx((6.0, 0.3), abs=1e-3)
    assert realism.motion_at(truth, 10_000_000) is None


def test_a_standing_point_has_no_residual_and_an_aliased_one_neither() -> None:
    mount = Mount(SE2(3.0, 0.5, 0.5), 1.2, 50.0)
    azimuth = np.array([-1.0, 0.0, 1.0])
    speed, yaw_rate = 9.0, 0.2
    bearing = azimuth + 0.5
    rate = -((speed - yaw_rate * 0.5) * np.cos(bearing) + yaw_rate * 3.0 * np.sin(bearing))
    for interval in (0.0, 12.0):
        scan = RadarScan("r", 0, 0, np.full(3, 9.0), azimuth, rate + interval, np.zeros(3), ambiguity=interval)
        np.testing.assert_allclose(realism.residual_of(scan, mount, speed, yaw_rate), 0.0, atol=1e-9)


def test_rings() -> None:
    rows = realism.by_ring(np.array([1.0, 2.0, 8.0, 9.0]), np.array([0.1, 3.0, 0.2, 0.4]))
    assert rows[0] == (pytest.approx(1.55), 0.5)
    assert rows[1] == (pytest.approx(0.3), 0.0)
    assert all(math.isnan(value) for value in rows[2])


def test_the_table_says_what_lies_outside() -> None:
    def drive(sigma: float) -> report.Drive:
        ring = [(0.1, 0.01)] * 3
        return report.Drive(np.array([1.0, 9.0, 30.0]), sigma, 0.05, 0.05, np.array([-20.0, -10.0, 0.0]), ring, 0.03)

    text = report.table({"A": drive(0.12), "B": drive(0.3)}, [drive(0.08), drive(0.15)])
    line = next(line for line in text.splitlines() if "robust sigma" in line)
    assert line.endswith("| 0.120 (A), 0.300 (B) | 0.080 … 0.115 … 0.150 | not B |")
    assert all(line.endswith("| yes |") for line in text.splitlines()[2:] if "robust sigma" not in line)


def test_the_table_goes_between_the_marks_of_a_document(tmp_path: Path) -> None:
    document = tmp_path / "simulator.md"
    document.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    report.put_into(document, "new")
    assert document.read_text() == f"before\n{report.BEGIN}\nnew\n{report.END}\nafter\n"
    document.write_text("no marks")
    with pytest.raises(EchogridError, match="has no place for the table"):
        report.put_into(document, "new")
    with pytest.raises(EchogridError, match="cannot be read"):
        report.put_into(tmp_path / "none.md", "new")
