"""Maps of several drives in one: as their tiles merge, whoever computes it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.support.stores import CELL, LEARNED, NAMES, content, described, random_tiles, window, write_store

from echogrid.core.map.merge import Source, merge_tile, placement, touched
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.maps import merge as merging
from echogrid.maps.merge import Input, merge, plan
from echogrid.store.tile_store import TileStore


def two_drives(tmp_path: Path) -> list[Input]:
    one = write_store(tmp_path / "one.egmap", random_tiles(1))
    two = write_store(tmp_path / "two.egmap", random_tiles(2), described(names=("rear", "front", "left")))
    three = write_store(tmp_path / "three.egmap", random_tiles(3), described(vehicle="van"))
    return [Input.parse(text) for text in (f"{one}", f"{two}:-40.5,12.1,33.7", f"{three}@1:8,-16,0")]


def test_files_merge_as_their_tiles_do(tmp_path: Path) -> None:
    inputs = two_drives(tmp_path)
    sentence = merge(inputs, tmp_path / "out.egmap")
    maps = [random_tiles(seed) for seed in (1, 2, 3)]
    bits = [(0, 1, 2), (2, 3, 0), (0, 1, 2)]
    sources = [Source(tiles.get, placement(one.merged_from_map, CELL), bit) for tiles, one, bit in zip(maps, inputs, bits, strict=True)]
    keys = {key for tiles, source in zip(maps, sources, strict=True) for tile in tiles for key in touched(tile, source.placement)}
    with TileStore(tmp_path / "out.egmap") as store:
        what = store.description(1)
        assert (what.radars, what.vehicle, what.kind, what.calibration) == ((*NAMES, "front"), "several", "looks", LEARNED)
        count = 0
        for key in sorted(keys):
            expected, found = merge_tile(key, sources, "looks", 3.5), store.read(1, key)
            assert (expected is None) == (found is None)
            if expected is not None and found is not None:
                count += 1
                for name in ("layers", "seen_s", "radars"):
                    assert getattr(found, name).tobytes() == getattr(expected, name).tobytes()
    assert count > 10
    assert sentence == f"{tmp_path / 'out.egmap'}: 3 maps in {count} tiles, radars left, right, rear, front"


def test_one_map_alone_or_a_turn_of_nothing_is_that_map(tmp_path: Path) -> None:
    path = write_store(tmp_path / "one.egmap", random_tiles(1))
    for name, text_ in (("a", str(path)), ("b", f"{path}@1:0,0,-360"), ("c", f"{path}:0.00000001,0,0")):
        merge([Input.parse(text_)], tmp_path / f"{name}.egmap")
        assert content(tmp_path / f"{name}.egmap") == content(path)
    moved = Input.parse(f"{path}:12.25,-3.5,0")
    merge([moved], tmp_path / "there.egmap")
    merge([Input.parse(f"{tmp_path / 'there.egmap'}:-12.25,3.5,0")], tmp_path / "back.egmap")
    np.testing.assert_array_equal(window(tmp_path / "back.egmap")[0], window(path)[0])
    assert Input.parse("a:b@2.egmap@3:1,-2,90") == Input(Path("a:b@2.egmap"), 3, SE2(1.0, -2.0, np.pi / 2))


def test_a_cluster_gives_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over TCP, so that jobs and tiles are what goes from process to process."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(merging, "AT_ONCE", 5)
    inputs = two_drives(tmp_path)
    merge(inputs, tmp_path / "here.egmap")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None
    ) as cluster:
        shares: list[float] = []
        merge(inputs, tmp_path / "there.egmap", scheduler=cluster.scheduler_address, on_progress=shares.append)
        assert content(tmp_path / "there.egmap") == content(tmp_path / "here.egmap")
        assert shares == sorted(shares)
        assert (len(shares) > 2, shares[-1]) == (True, 1.0)
        _, jobs = plan(inputs)
        (tmp_path / "one.egmap").write_bytes(b"")
        with pytest.raises(EchogridError, match="one.egmap"):
            merge(inputs, tmp_path / "nothing.egmap", scheduler=cluster.scheduler_address)
    assert len(jobs) > 10
    assert list(tmp_path.glob("*nothing*")) == []


def test_a_merge_that_is_interrupted_leaves_nothing_and_one_that_was_killed_does_no_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = two_drives(tmp_path)
    monkeypatch.setattr(merging, "AT_ONCE", 3)
    out = tmp_path / "out.egmap"
    before = {path.name for path in tmp_path.iterdir()}

    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        merge(inputs, out, on_progress=stop)
    assert {path.name for path in tmp_path.iterdir()} == before

    def keep(share: float) -> None:
        if share > 0.5:
            for path in tmp_path.glob(".out.egmap.partial*"):
                shutil.copy(path, tmp_path / f"killed{path.name.removeprefix('.out.egmap.partial')}")

    merge(inputs, out, on_progress=keep)
    expected = content(out)
    left = list(tmp_path.glob("killed*"))
    assert {path.name for path in left} >= {"killed", "killed-wal"}
    for path in left:
        path.rename(tmp_path / f".out.egmap.partial{path.name.removeprefix('killed')}")
    merge(inputs, out, force=True)
    assert content(out) == expected
    with TileStore(out) as store:
        assert [epoch.id for epoch in store.epochs()] == [1]  # nothing of the killed one's
    assert {path.name for path in tmp_path.iterdir()} == before | {"out.egmap"}
