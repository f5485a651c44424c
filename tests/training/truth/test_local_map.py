"""The map around the car beside the truth, cell by cell, along a drive round a room."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import networks
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import track

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE, Tile
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.truth.local_map import LocalMap, local_maps, patch

SMALL = GridSpec(cells=12, cell=0.25)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine metres round a bend to the left."""
    folder = tmp_path_factory.mktemp("local") / "drive"
    return room_drive(folder, track(3.0, speed=3.0, yaw_rate=0.3, x=-4.0), width=20.0)


@pytest.fixture(scope="module")
def found(drive: Path) -> list[LocalMap]:
    return list(local_maps(drive, "analytic", every=2.0))


@settings(max_examples=30)
@given(st.builds(SE2, st.floats(-40, 40), st.floats(-40, 40), st.floats(-7, 7)), st.sampled_from([OccupancyMap, LookMap]))
def test_a_patch_is_the_map_read_cell_by_cell(pose: SE2, kind: type[TiledMap]) -> None:
    """Near a corner of four tiles, some of which were never seen."""
    occupancy = OccupancyMap(SMALL) if kind is OccupancyMap else LookMap(SMALL, Calibration())
    rng = np.random.default_rng(1)
    for tile in ((0, 0), (-1, 0), (1, -2)):
        occupancy.tiles[tile] = Tile.empty(occupancy.layers)
        occupancy.tiles[tile].layers[:] = rng.normal(size=(occupancy.layers, SIDE, SIDE))
    read = patch(occupancy, pose, SMALL)
    assert read.shape == (occupancy.layers, 12, 12)
    for i, j in np.ndindex(12, 12):
        x, y = ((j + 0.5) * 0.25 - 1.5, (i + 0.5) * 0.25 - 1.5)
        ((there_x, there_y),) = pose.apply(np.array([(x, y)]))
        column, row = math.floor(there_x / 0.25), math.floor(there_y / 0.25)
        np.testing.assert_array_equal(read[:, i, j], occupancy.window_of_layers(row, column, 1, 1)[:, 0, 0])


def test_map_and_truth_show_the_same_walls_in_the_same_cells(found: list[LocalMap]) -> None:
    """By the analytic model: most of what it calls occupied lies within two cells of a true wall, in base, whatever the pose; and most of
    what it calls free is."""
    near, free = [], []
    for local in found:
        (log_odds,) = local.layers
        walls = np.argwhere(local.truth > 0)
        near += [np.abs(walls - cell).max(axis=1).min() <= 2 for cell in np.argwhere((log_odds > 1) & (local.truth != 0))]
        free += (local.truth[(log_odds < -1) & (local.truth != 0)] < 0).tolist()
    assert len(near) > 100
    assert len(free) > 1000
    assert np.mean(near) > 0.9
    assert np.mean(free) > 0.97


def test_looks_at_the_map_are_as_far_apart_as_is_asked(drive: Path, found: list[LocalMap]) -> None:
    """Nine metres: none at the start, where there is no map, then one every two."""
    assert len(found) == 4
    assert len(list(local_maps(drive, "analytic", every=4.0))) == 2


def test_with_a_network_the_map_has_its_layers(drive: Path, tmp_path: Path) -> None:
    spec = GridSpec()
    net = networks.write(tmp_path / "net.onnx", *networks.default(spec.cells, spec.cell))
    looks = list(local_maps(drive, str(net), every=4.0))
    assert len(looks) == 2
    for local in looks:
        assert local.layers.shape == (5, 128, 128)
        _, weight, hits, near, passes = local.layers
        assert 0 < weight.max() <= 20 + 1e-4
        assert 0 < (hits + passes).max() <= 60 + 1e-3
        assert (near >= 0).all()


def test_what_is_no_simulated_drive_is_said(tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match="there is no such file or folder"):
        next(local_maps(tmp_path / "nothing", "analytic"))
