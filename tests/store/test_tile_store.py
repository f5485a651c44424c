"""The tiles of a store against plain arrays, and against readers that know the documentation alone."""

from __future__ import annotations

import math
import re
import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from tests.support.places import DOCS
from tests.support.stores import LOOKS, SUM, filled, random_tile, same

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.map.tiled_map import View
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.store.store_file import StoreError
from echogrid.store.stored_map import describe, stored_map
from echogrid.store.tile_store import TileStore


def test_what_was_written_is_read_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "a.egmap"
    written: dict[tuple[int, TileKey], Tile] = {}
    with TileStore(path, write=True) as store, TileStore(path) as reader:
        for description in (LOOKS, SUM):
            epoch = store.begin(description)
            for stamp_ns in (100, 200):
                keys = [(int(row), int(column)) for row, column in rng.integers(-3, 3, (8, 2))]
                tiles = {key: random_tile(rng, description.layers) for key in keys}
                store.write(epoch, tiles, stamp_ns)
                written |= {(epoch, key): tile for key, tile in tiles.items()}
        for (epoch, key), tile in written.items():  # another connection, while the first is open
            assert same(reader.read(epoch, key), tile)
        assert {(epoch, key) for epoch in reader.numbers() for key in reader.tiles(epoch)} == written.keys()
        assert reader.read(1, (99, 99)) is None
        assert reader.read(99, (0, 0)) is None
    with TileStore(path) as reader:
        looks, total = reader.epochs()
        assert (looks.id, looks.description, looks.newest_ns) == (1, LOOKS, 200)
        assert (total.id, total.description, total.tiles) == (2, SUM, sum(epoch == 2 for epoch, _ in written))
        assert looks.bytes > looks.tiles * 100_000
        with pytest.raises(EchogridError, match=r"a\.egmap: epoch 7 is not there, found 1, 2"):
            reader.description(7)


def test_a_reader_written_from_the_documentation_alone_reads_the_same(tmp_path: Path) -> None:
    """docs/store.md in a dozen lines: sqlite3, zstd and struct."""
    tile, path = random_tile(np.random.default_rng(1)), tmp_path / "a.egmap"
    with TileStore(path, write=True) as store:
        store.write(store.begin(LOOKS), {(3, -4): tile}, 5)
    connection = sqlite3.connect(path)
    try:
        assert connection.execute("PRAGMA application_id").fetchone()[0] == int.from_bytes(b"egmp", "big")
        ((row, col, data),) = connection.execute("SELECT row, col, data FROM tile WHERE epoch = 1").fetchall()
    finally:
        connection.close()
    raw = zstandard.ZstdDecompressor().decompress(data)
    cells = 128 * 128
    assert (row, col, len(raw)) == (3, -4, 26 * cells)
    for i, j, layer in ((0, 0, 0), (5, 77, 4), (127, 127, 1)):
        n, count = (layer * 128 + i) * 128 + j, 5 * cells
        assert struct.unpack("<f", bytes(raw[n + byte * count] for byte in range(4)))[0] == tile.layers[layer, i, j]
        n = i * 128 + j
        assert struct.unpack("<I", bytes(raw[20 * cells + n + byte * cells] for byte in range(4)))[0] == tile.seen_s[i, j]
        assert struct.unpack("<H", bytes(raw[24 * cells + n + byte * cells] for byte in range(2)))[0] == tile.radars[i, j]


def test_the_reader_in_the_documentation_reads_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tile, text = random_tile(np.random.default_rng(1)), (DOCS / "store.md").read_text()
    with TileStore(tmp_path / "map.egmap", write=True) as store:
        store.write(store.begin(LOOKS), {(3, -4): tile}, 5)
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    try:
        exec(text.split("```python\n")[1].split("```")[0], found)
    finally:
        found["db"].close()
    assert same(Tile(found["layers"], found["seen_s"], found["seen_by"]), tile)
    assert (found["y"], found["x"]) == (96.0, -128.0)


def test_tables_numbers_and_sizes_in_the_documentation_are_those_of_a_file(tmp_path: Path) -> None:
    text = (DOCS / "store.md").read_text()
    with TileStore(tmp_path / "map.egmap", write=True) as store:
        store.begin(LOOKS)
    connection = sqlite3.connect(tmp_path / "map.egmap")
    try:
        columns = {table: connection.execute(f"PRAGMA table_info({table})").fetchall() for table in ("epoch", "tile")}
        for table, found in columns.items():
            (inside,) = re.findall(rf"CREATE TABLE {table}\((.*)\)", text)
            told = [part.split()[:2] for part in inside.split(", PRIMARY KEY(")[0].split(", ")]
            assert told == [[name, kind] for _, name, kind, *_ in found]
        assert f"`application_id` 0x{connection.execute('PRAGMA application_id').fetchone()[0]:X}" in text
        assert f"`user_version` {connection.execute('PRAGMA user_version').fetchone()[0]}" in text
    finally:
        connection.close()
    for kind, name in ((LookMap, "`looks`"), (OccupancyMap, "`sum`")):
        tile = Tile.empty(kind.layers)
        size = sum(array.nbytes for array in (tile.layers, tile.seen_s, tile.radars)) / 1024
        assert re.search(rf"{name} (takes )?{size:g} KiB", text)


def test_a_cells_log_odds_are_what_the_documentation_makes_of_its_layers() -> None:
    """The rule of docs/fusion.md with the numbers that stand there, a cell at a time, of the layers as docs/store.md has them."""
    text, n = (DOCS / "fusion.md").read_text(), r"(−?[\d.]+)"

    def told(pattern: str) -> list[float]:
        found = re.search(pattern, text)
        assert found, pattern
        return [float(number.replace("−", "-")) for number in found.groups()]

    passed, power, none = told(rf"free    = ln\({n} p\^{n} \+ {n}\)")
    share, least, most = told(rf"prior   = clip\({n} z, {n}, {n}\) − free")
    hit, of_hits = told(rf"inside  = prior \+ ln\({n} h \+ {n}\)")
    near, beside_none, doubt, slope = told(rf"beside  = prior \+ ln\({n} v \+ {n}\),  what of it exceeds {n} counts by {n}")
    steep, alone_from, enough = told(rf"alone   = min\({n} z \+ {n}, {n}\) − free")
    (surer,) = told(rf"log-odds = −2.2 \+ {n} \(all \+ 2.2\) +where all < −2.2")
    (undecided,) = told(rf"= {n} \(1 − \(1 \+ all / 2.2\)³\) +up to 0")
    (calmer,) = told(rf"= {n} all +from there on")
    assert math.log(0.1 / 0.9) == pytest.approx(doubt, abs=0.01)  # "−2.2 is p = 0.1"
    doubt = math.log(0.1 / 0.9)

    rng = np.random.default_rng(3)
    layers = rng.uniform(0.0, 20.0, (5, 8, 50)).astype(np.float32) * (rng.uniform(size=(5, 8, 50)) < 0.7)
    layers[0] = rng.normal(0.0, 4.0, (8, 50)) * layers[1]
    a, b = 1.3, 0.2
    found = LookMap(GridSpec(32, 0.25), Calibration(a, b)).read(layers)
    for i, j in np.ndindex(8, 50):
        s, w, h, v, p = (float(value) for value in layers[:, i, j])
        if not any((s, w, h, v, p)):
            assert found[i, j] == 0
            continue
        z = a * s / w + b if w else 0.0
        free = math.log(passed * p**power + none)
        prior = min(max(share * z, least), most) - free
        inside, beside = prior + math.log(hit * h + of_hits), prior + math.log(near * v + beside_none)
        beside = doubt + slope * (beside - doubt) if beside > doubt else beside
        alone = math.exp(2 * (min(steep * z + alone_from, enough) - free)) if w else 0.0
        log_odds = 0.5 * math.log(math.exp(2 * inside) + math.exp(2 * beside) + alone)
        if log_odds < doubt:
            log_odds = doubt + surer * (log_odds - doubt)
        else:
            log_odds = undecided * (1 - (1 - log_odds / doubt) ** 3) if log_odds < 0 else calmer * log_odds
        assert found[i, j] == pytest.approx(log_odds, abs=1e-3)


@pytest.mark.parametrize("kind", [LookMap, OccupancyMap])
def test_a_stored_map_reads_as_the_one_that_was_stored(tmp_path: Path, kind: type) -> None:
    spec = GridSpec(32, 0.25)
    occupancy = LookMap(spec, Calibration(1.3, 0.2)) if kind is LookMap else OccupancyMap(spec, 2.0)
    rng = np.random.default_rng(2)
    for n in range(100):
        said = rng.uniform(0, 1, (2, 32, 32)).astype(np.float32)
        pose = SE2(*rng.uniform(-150, 150, 2).tolist(), float(rng.uniform(-4, 4)))
        occupancy.integrate(said if kind is LookMap else said[0], pose, View(n * 10**9, np.ones((32, 32), np.uint16)))
    assert len(occupancy.tiles) > 64  # more than a stored map has in memory
    with TileStore(tmp_path / "a.egmap", write=True) as store:
        epoch = store.begin(describe(occupancy, "car", ("front",), 1))
        store.write(epoch, occupancy.tiles, 5)
        stored = stored_map(store, epoch)
        assert type(stored) is kind
        assert stored.bounds() == occupancy.bounds()
        everywhere = occupancy.bounds()
        assert stored.window(*everywhere).tobytes() == occupancy.window(*everywhere).tobytes()
        assert stored.whole()[:2] == occupancy.whole()[:2]
        for one, other in zip(stored.window_of_views(*everywhere), occupancy.window_of_views(*everywhere), strict=True):
            np.testing.assert_array_equal(one, other)
        with pytest.raises(TypeError):
            stored.clear()


def test_epochs_count_on_and_empty_ones_go(tmp_path: Path) -> None:
    path, tile = tmp_path / "a.egmap", Tile.empty(5)
    for expected in (1, 2, 3):  # opened anew each time, never a tile
        with TileStore(path, write=True) as store:
            assert store.next_epoch() == expected == store.begin(LOOKS)
            assert store.numbers() == [expected]
    with TileStore(path, write=True) as store:
        store.write(3, {(0, 0): tile}, 1)
        assert store.begin(LOOKS, 9) == 9
        store.forget(9)
        store.forget(3)
        assert store.begin(SUM) == 10  # never a number twice
        with pytest.raises(StoreError, match="epoch 10 should start, but 10 has started: another process writes this file"):
            store.begin(LOOKS, 10)
        assert store.numbers() == [10]


def test_what_is_forgotten_makes_room_and_the_file_can_shrink(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = tmp_path / "a.egmap"
    with TileStore(path, write=True) as store:
        for stamp_ns in range(3):
            epoch = store.begin(LOOKS)
            store.write(epoch, {(n, n): random_tile(rng) for n in range(10)}, stamp_ns)
        full, used = store.size(), store.used()
        assert full == used
        store.forget(1)
        assert store.used() == pytest.approx(used * 2 / 3, rel=0.02)
        assert store.size() == full
        store.write(3, {(n, -n): random_tile(rng) for n in range(1, 9)}, 4)
        assert store.size() == full  # what comes next has room in it
        assert [key for key in store.forget_oldest(3) if key[0] == -key[1] != 0] == [(n, -n) for n in range(1, 9)]
        store.shrink(full // 2)
        assert full * 0.4 < store.size() <= full // 2
        store.shrink()
        assert store.size() == store.used() < full * 0.4
        assert path.stat().st_size == store.size()
        assert store.tiles(2) == [(n, n) for n in range(10)]
        assert store.read(2, (4, 4)) is not None


def test_the_tiles_written_longest_ago_are_the_oldest(tmp_path: Path) -> None:
    with TileStore(tmp_path / "a.egmap", write=True) as store:
        epoch = store.begin(SUM)
        for stamp_ns in (3, 1, 2):
            store.write(epoch, {(stamp_ns, n): Tile.empty(1) for n in range(40)}, stamp_ns)
        assert store.forget_oldest(epoch) == [(1, n) for n in range(40)] + [(2, n) for n in range(24)]
        assert len(store.tiles(epoch)) == 56


def test_many_writes_keep_the_wal_file_small(tmp_path: Path) -> None:
    path, rng = tmp_path / "a.egmap", np.random.default_rng(4)
    with TileStore(path, write=True) as store, TileStore(path) as reader:
        epoch = store.begin(LOOKS)
        for n in range(20):
            store.write(epoch, {(n % 10, column): random_tile(rng) for column in range(4)}, n)
            assert reader.read(epoch, (n % 10, 0)) is not None
        assert store.size() > 10 << 20
        store.forget(epoch)  # what goes is not written again
        assert path.with_name("a.egmap-wal").stat().st_size < 6 << 20
    assert [file.name for file in tmp_path.iterdir()] == ["a.egmap"]  # closed, there is nothing beside it


@pytest.mark.parametrize("data", [b"", b"nothing", zstandard.compress(b"short"), zstandard.compress(bytes(22 * SIDE * SIDE + 1))])
def test_data_that_is_no_tile_is_one_sentence(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.egmap"
    filled(path, tiles=1)
    connection = sqlite3.connect(path)
    connection.execute("UPDATE tile SET data = ?", (data,))
    connection.commit()
    connection.close()
    with TileStore(path) as store, pytest.raises(StoreError, match=r"a\.egmap: tile \(0, 0\) of epoch 1 is damaged"):
        store.read(1, (0, 0))


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    filled(path, tiles=1)
    bomb = zstandard.compress(bytes(1 << 28), level=1)
    assert len(bomb) < 1 << 20
    connection = sqlite3.connect(path)
    connection.execute("UPDATE tile SET data = ?", (bomb,))
    connection.commit()
    connection.close()
    with TileStore(path) as store, pytest.raises(StoreError, match="268435456 bytes found, expected 425984"):
        store.read(1, (0, 0))
