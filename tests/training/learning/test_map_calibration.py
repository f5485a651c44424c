"""The read-out of the default map against scipy's optimum of the same likelihood, on cells gathered one map at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from tests.support import networks
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import town, track

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import simulate
from echogrid_training.learning import map_calibration
from echogrid_training.learning.map_calibration import calibrate_map
from echogrid_training.sensors.episode import paper_like
from echogrid_training.truth.local_map import LocalMap, local_maps


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two rooms, eleven metres through each."""
    out = tmp_path_factory.mktemp("calibration")
    for seed, width in ((3, 14.0), (4, 24.0)):
        room_drive(out / f"room-{seed}", track(1.8, speed=6.0, x=-5.0), length=30.0, width=width, seed=seed)
    return sorted(out.iterdir())


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = GridSpec()
    return networks.write(tmp_path_factory.mktemp("net") / "net.onnx", *networks.default(spec.cells, spec.cell))


def test_the_read_out_has_the_greatest_likelihood(drives: list[Path], net: Path) -> None:
    rows: list[tuple[float, bool]] = []
    for drive in drives:
        for local in local_maps(drive, str(net)):
            for i, j in np.argwhere(local.truth != 0):
                total, weight = (float(value) for value in local.layers[:2, i, j])
                if weight > 0.05:
                    rows.append((total / weight, bool(local.truth[i, j] > 0)))
    mean, occupied = (np.array(column) for column in zip(*rows, strict=True))
    assert len(rows) > 10_000
    assert 0.01 < occupied.mean() < 0.5

    def unlikely(of: np.ndarray) -> float:
        z = of[0] * mean + of[1]
        return float(np.logaddexp(0, np.where(occupied, -z, z)).mean())

    best = minimize(unlikely, (1.0, 0.0), method="Powell", options={"xtol": 1e-8, "ftol": 1e-14})
    found = calibrate_map(drives, net)
    np.testing.assert_allclose((found.learned, found.offset), best.x, atol=2e-3)
    assert unlikely(np.array((found.learned, found.offset))) < 0.98 * unlikely(np.array((1.0, 0.0)))


def test_little_evidence_is_evidence_and_what_is_hardly_observable_is_none(monkeypatch: pytest.MonkeyPatch, net: Path) -> None:
    """Cells of a single look at a surface that others passed; those that are held for observable by just 0.05 would say the contrary."""
    rng = np.random.default_rng(5)
    mean, weight = rng.normal(0, 2, (64, 64)), rng.choice([0.05, 0.9], (64, 64), p=[0.3, 0.7]).astype(np.float32)
    occupied = rng.uniform(size=mean.shape) < 1 / (1 + np.exp(0.4 - 0.7 * mean))
    truth = np.where(occupied ^ (weight < 0.5), 0.5, -0.5).astype(np.float32)
    layers = np.stack((mean * weight, weight, *np.zeros((3, 64, 64)))).astype(np.float32)
    monkeypatch.setattr(map_calibration, "local_maps", lambda drive, model: [LocalMap(layers, truth)])
    found = calibrate_map([Path("a"), Path("b")], net)
    assert (found.learned, found.offset) == pytest.approx((0.7, -0.4), abs=0.1)
    assert (found.learned, found.offset) == (round(found.learned, 4), round(found.offset, 4))


def test_without_way_or_drives_the_networks_word_stands(net: Path, tmp_path: Path) -> None:
    recording, truth = simulate(town(ego=track(1.0)), paper_like(1))
    write_drive(recording, tmp_path / "standing", truth_map=truth)
    assert calibrate_map([tmp_path / "standing"], net) == calibrate_map([], net) == Calibration(1.0, 0.0)
