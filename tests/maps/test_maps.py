"""Stored maps through the commands: what comes out is what is in, whoever computes it, and every mistake is one sentence."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from echogrid.core.map.look_map import Calibration
from echogrid.core.map.merge import Source, merge_tile, placement, touched
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.maps import map_server
from echogrid.maps import merge as merging
from echogrid.maps import show as showing
from echogrid.maps.dense_map import MOST_CELLS, read_npz
from echogrid.maps.export import export, parse_box
from echogrid.maps.importing import import_map
from echogrid.maps.info import info, lines
from echogrid.maps.merge import Input, merge, plan
from echogrid.maps.picture import shade, text
from echogrid.maps.show import show
from echogrid.store.epoch import Description
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore

CELL = 0.25
LEARNED = Calibration(1.5, -0.25)
NAMES = ("left", "right", "rear")
Tiles = dict[TileKey, Tile]


def described(kind: str = "looks", names: tuple[str, ...] = NAMES, cell: float = CELL, vehicle: str = "car") -> Description:
    return Description(1_700_000_000_000_000_000, vehicle, cell, kind, 3.5, LEARNED if kind == "looks" else Calibration(), names)


def random_tiles(seed: int, keys: tuple[TileKey, ...] = ((0, 0), (0, 1), (-1, 3)), kind: str = "looks") -> Tiles:
    rng = np.random.default_rng(seed)
    tiles = {}
    for key in keys:
        tile = tiles[key] = Tile.empty(4 if kind == "looks" else 1)
        some = rng.uniform(size=(SIDE, SIDE)) < 0.1
        some[:20] = False
        tile.layers[:] = np.where(some, rng.normal(0, 1, tile.layers.shape).clip(-3.5, 3.5), 0)
        if kind == "looks":
            tile.layers[2] = np.where(some, rng.uniform(0.25, 5, some.shape), 0)
            tile.layers[1] = tile.layers[2] * rng.uniform(0, 1, some.shape)
            tile.layers[3][rng.uniform(size=some.shape) < 0.5] = 0
        tile.seen_s[:] = np.where(some, rng.integers(1_700_000_000, 1_700_000_900, some.shape), 0)
        tile.radars[:] = np.where(some, rng.integers(1, 8, some.shape), 0)
    return tiles


def write_store(path: Path, tiles: Tiles, what: Description | None = None) -> Path:
    """A new epoch of it; every tile has a stamp of its own."""
    with TileStore(path, write=True) as store:
        number = store.begin(what or described())
        for n, (key, tile) in enumerate(tiles.items()):
            store.write(number, {key: tile}, 1_700_000_000_000_000_000 + n)
        store.seal()
    return path


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Three epochs: of `sum`, without tiles, and the newest one, of `looks`."""
    path = write_store(tmp_path / "car.egmap", random_tiles(1, kind="sum"), described("sum"))
    write_store(path, {})
    return write_store(path, random_tiles(2))


def content(path: Path, epoch: int | None = None) -> str:
    """A hash of an epoch: what it is, and every bit of every tile."""
    digest = hashlib.sha256()
    with TileStore(path) as store:
        number = store.epochs()[-1].id if epoch is None else epoch
        digest.update(repr(store.description(number)).encode())
        for key in store.tiles(number):
            tile = store.read(number, key)
            assert tile is not None
            digest.update(repr(key).encode() + tile.layers.tobytes() + tile.seen_s.tobytes() + tile.radars.tobytes())
    return digest.hexdigest()


def window(path: Path, epoch: int | None = None) -> tuple[np.ndarray, tuple[float, float]]:
    """All known cells by the map's own reading, and where they begin."""
    with TileStore(path) as store:
        number = store.epochs()[-1].id if epoch is None else epoch
        cell = store.description(number).cell
        row, column, log_odds = stored_map(store, number).whole()
    return log_odds, (column * cell, row * cell)


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


def echogrid(*arguments: str | Path, module: str = "echogrid") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", module, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


# --- export, import


def test_an_epoch_as_a_store_of_its_own_is_the_same_bits(stored: Path, tmp_path: Path) -> None:
    for epoch in (1, 3):
        out = tmp_path / f"{epoch}.egmap"
        assert export(stored, out, epoch=epoch).startswith(f"{out}: 3 tiles of epoch {epoch}, as they are")
        assert content(out) == content(stored, epoch)
        with TileStore(out) as one, TileStore(stored) as other:
            assert [found.id for found in one.epochs()] == [epoch]
            assert [one.stamp_ns(epoch, key) for key in one.tiles(epoch)] == [other.stamp_ns(epoch, key) for key in other.tiles(epoch)]
    assert sorted(path.name for path in tmp_path.glob("*3*")) == ["3.egmap"]  # one file: no WAL beside it
    export(stored, tmp_path / "part.egmap", box=(31.9, -5.0, 32.0, 1.0))  # m: the last column of tile 0 alone
    with TileStore(tmp_path / "part.egmap") as part:
        assert part.tiles(3) == [(0, 0)]


def test_an_npz_holds_every_cell_and_comes_back(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.npz")
    export(stored, tmp_path / "again.npz")
    assert (tmp_path / "map.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()
    log_odds, origin = window(stored)
    with np.load(tmp_path / "map.npz") as file:
        assert set(file) == {"log_odds", "origin", "cell", "seen_s", "radars", "measured", "names"}
        np.testing.assert_array_equal(file["log_odds"], log_odds)
        assert (file["origin"].tolist(), file["cell"], file["names"].tolist()) == (list(origin), CELL, list(NAMES))
        with TileStore(stored) as store:
            occupancy = stored_map(store, 3)
            where = (round(origin[1] / CELL), round(origin[0] / CELL), *log_odds.shape)
            seen_s, radars = occupancy.window_of_views(*where)
            np.testing.assert_array_equal(file["seen_s"], seen_s)
            np.testing.assert_array_equal(file["radars"], radars)
            np.testing.assert_array_equal(file["measured"], (occupancy.window_of_layers(*where)[3] != 0) & (log_odds != 0))
    sentence = import_map(tmp_path / "map.npz", tmp_path / "back.egmap", vehicle="van")
    assert sentence.endswith(f"not in {tmp_path / 'map.npz'}: what was measured and what learned")
    export(tmp_path / "back.egmap", tmp_path / "back.npz")
    one, two = read_npz(tmp_path / "map.npz"), read_npz(tmp_path / "back.npz")
    assert (one.origin, one.cell, one.names) == (two.origin, two.cell, two.names)
    for name in ("log_odds", "seen_s", "radars"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    with TileStore(tmp_path / "back.egmap") as store:
        what = store.description(1)
        assert (what.kind, what.vehicle, what.begun_ns) == ("sum", "van", int(one.seen_s[one.seen_s > 0].min()) * 10**9)


@pytest.mark.parametrize("mode", map_server.MODES)
def test_map_server_files_go_out_and_come_back(stored: Path, tmp_path: Path, mode: str) -> None:
    yaml = tmp_path / "map.yaml"
    sentence = export(stored, yaml, epoch=1, mode=mode)
    log_odds, origin = window(stored, 1)
    assert sentence.startswith(f"{yaml}: {log_odds.shape[1]} x {log_odds.shape[0]} cells of 0.25 m; not in it: ")
    header = map_server.read_header(yaml)
    assert (header.origin, header.cell, header.mode) == (origin, CELL, mode)
    np.testing.assert_array_equal(pixels(header.image), map_server.pixels_of(log_odds, mode))
    sentence = import_map(yaml, tmp_path / "back.egmap")
    assert "probabilities finer than the picture's" in sentence
    assert "when a cell was in view, by which radar" in sentence
    assert "moved" not in sentence
    export(tmp_path / "back.egmap", tmp_path / "back.yaml", mode=mode)
    back, again = map_server.read(yaml), map_server.read(tmp_path / "back.yaml")
    known = back.log_odds != 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    np.testing.assert_array_equal(back.log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], again.log_odds)
    assert again.origin == (origin[0] + columns[0] * CELL, origin[1] + rows[0] * CELL)


def test_what_lies_between_cells_is_moved_onto_them_and_said(tmp_path: Path) -> None:
    map_server.write(tmp_path / "map.yaml", np.zeros((4, 4), np.uint8), (1.1, -0.3), CELL, "trinary")
    assert "; moved by 0.100 m, onto whole cells; not in" in import_map(tmp_path / "map.yaml", tmp_path / "map.egmap")
    log_odds, origin = window(tmp_path / "map.egmap")
    assert (log_odds.tolist(), origin) == ([[3.5] * 4] * 4, (1.0, -0.25))


def test_a_box_cuts_the_cells_that_it_touches(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.npz", box=parse_box("-1.1,5.25,40,31.9"))
    with np.load(tmp_path / "map.npz") as file, TileStore(stored) as store:
        assert file["origin"].tolist() == [-1.25, 5.25]
        np.testing.assert_array_equal(file["log_odds"], stored_map(store, 3).window(21, -5, 107, 165))


def test_a_picture_has_a_pixel_for_each_cell(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.png")
    np.testing.assert_array_equal(pixels(tmp_path / "map.png"), shade(window(stored)[0])[::-1])


def test_maps_that_no_picture_can_hold(tmp_path: Path) -> None:
    """A road of 320 km: shown, exported as a store or in parts, but not as one picture, and no memory is asked for."""
    tiles = random_tiles(5, ((0, 0), (10_000, 10_000)))
    path = write_store(tmp_path / "far.egmap", tiles)
    with pytest.raises(EchogridError, match=r"epoch 1: \d+ x \d+ cells \(320.0 x 320.0 km\) are more than the 64 Mi that one .* --bbox"):
        export(path, tmp_path / "map.npz")
    assert [path.name for path in tmp_path.glob("*map.npz*")] == []
    export(path, tmp_path / "map.npz", box=(319_990.0, 319_990.0, 320_040.0, 320_040.0))
    assert (read_npz(tmp_path / "map.npz").log_odds != 0).sum() > 500
    export(path, tmp_path / "copy.egmap")
    assert content(tmp_path / "copy.egmap") == content(path)
    with pytest.raises(EchogridError, match="epoch 1: spreads over 320 x 320 km, too far for a picture"):
        show(path)
    seen = show(write_store(tmp_path / "road.egmap", random_tiles(5, ((0, 0), (1, 60_000)))))
    assert seen.shape[0] <= 2
    assert 900 <= seen.shape[1] <= 1600
    assert (np.count_nonzero(seen[:, 1:-1]), bool(seen[0, 0]), bool(seen[-1, -1])) == (0, True, True)


# --- show, info


def test_every_format_shows_the_same_map(stored: Path, tmp_path: Path) -> None:
    """As the terminal's text of all cells; a picture with a scale beside it."""
    log_odds, _ = window(stored, 1)
    expected = text(log_odds, 100)
    export(stored, tmp_path / "map.npz", epoch=1)
    export(stored, tmp_path / "map.yaml", epoch=1, mode="scale")
    rounded = text(map_server.read(tmp_path / "map.yaml").log_odds, 100)
    for path, epoch, whole in ((stored, 1, expected), (tmp_path / "map.npz", None, expected), (tmp_path / "map.yaml", None, rounded)):
        assert text(show(path, epoch=epoch, out=tmp_path / f"{path.name}.png"), 100) == whole
        with Image.open(tmp_path / f"{path.name}.png") as picture:
            assert picture.width >= log_odds.shape[1]
    assert expected.count("255") > 100


def test_a_wide_map_shows_small_all_that_is_occupied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell for part of a tile, for a whole one, for several: occupied where any of its cells is, else free where any is."""
    monkeypatch.setattr(showing, "LONGEST", 20)
    for far, step in ((9, 64), (15, 128), (40, 512)):
        keys = ((0, 0), (1, 2), (far // 5, far))
        path = write_store(tmp_path / f"{far}.egmap", random_tiles(far, keys, "sum"), described("sum"))
        with TileStore(path) as store:
            occupancy = stored_map(store, 1)
            whole = occupancy.window(*occupancy.bounds())
        whole = np.pad(whole, [(0, -length % step) for length in whole.shape])
        blocks = whole.reshape(len(whole) // step, step, -1, step)
        occupied, free = blocks.max(axis=(1, 3)) > 1, blocks.min(axis=(1, 3)) < 0
        seen = show(path)
        assert max(seen.shape) <= 20
        np.testing.assert_array_equal(
            np.pad(seen, [(0, all_ - ours) for all_, ours in zip(occupied.shape, seen.shape, strict=True)]) > 1, occupied
        )
        assert (seen < 0).sum() == (free & ~occupied).sum()


def test_info_counts_what_is_there(stored: Path) -> None:
    found = info(stored)
    assert (found["version"], [epoch["epoch"] for epoch in found["epochs"]]) == (1, [1, 3])  # an epoch without tiles goes with the next
    for epoch in found["epochs"]:
        log_odds, origin = window(stored, epoch["epoch"])
        assert epoch["known_cells"] == np.count_nonzero(log_odds)
        assert epoch["area_m2"] == pytest.approx(np.count_nonzero(log_odds) * 0.0625, abs=1e-3)
        height, width = log_odds.shape
        assert epoch["bounds_m"] == [*origin, origin[0] + width * CELL, origin[1] + height * CELL]
        seen_s = np.concatenate([tile.seen_s[tile.seen_s > 0] for tile in random_tiles(2, kind="looks").values()])
        assert (epoch["tiles"], epoch["radars"], epoch["cell_m"], epoch["vehicle"]) == (3, list(NAMES), CELL, "car")
        if epoch["kind"] == "looks":
            assert (epoch["oldest_s"], epoch["newest_s"]) == (seen_s.min(), seen_s.max())
            assert 0 < epoch["measured_cells"] < epoch["known_cells"]
    text_ = "\n".join(lines(found, 1_700_007_200.0))
    assert "epoch 3: vehicle 'car', begun 2023-11-14 22:13:20 UTC" in text_
    assert "(2 h ago)" in text_
    assert "radars   left, right, rear" in text_


def test_the_commands_from_a_terminal(stored: Path, tmp_path: Path) -> None:
    done = echogrid("map", "info", "--json", stored)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == info(stored)
    done = echogrid("map", "export", stored, tmp_path / "cut.npz", "--epoch", "1", "--bbox=-1,-1,9.5,9.5")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{tmp_path / 'cut.npz'}: 42 x 42 cells of 0.25 m; not in it: ")
    done = echogrid("map", "show", tmp_path / "cut.npz")
    assert (done.returncode, done.stderr, "▀" in done.stdout) == (0, "", True)
    (tmp_path / "maps.txt").write_text(f"{stored}\n{stored}@3:2.5,0,0\n")
    done = echogrid("map", "merge", tmp_path / "merged.egmap", f"@{tmp_path / 'maps.txt'}")
    assert (done.returncode, done.stderr) == (0, "")
    merge([Input.parse(str(stored)), Input.parse(f"{stored}:2.5,0,0")], tmp_path / "again.egmap")
    assert content(tmp_path / "merged.egmap") == content(tmp_path / "again.egmap")
    done = echogrid("map", "export", stored, tmp_path / "cut.npz")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"echogrid: {tmp_path / 'cut.npz'}: is there already: name another output, or give --force to replace it\n"


WRITER = """
import sys
from pathlib import Path
from tests.maps.test_maps import described, random_tiles
from echogrid.store.tile_store import TileStore
with TileStore(Path(sys.argv[1]), write=True) as store:
    number = store.begin(described())
    for n in range(1_000_000):
        store.write(number, random_tiles(n % 7, ((n % 5, n % 3), (0, 0))), 10**18 + n)
        if n == 2:
            print("writing", flush=True)
"""


@pytest.fixture
def written(tmp_path: Path) -> Iterator[Path]:
    """A store that another process writes to, all the time."""
    path = tmp_path / "live.egmap"
    with subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "writing\n"
        yield path
        assert writer.poll() is None
        writer.kill()


def test_a_store_that_is_being_written_can_be_read_but_not_replaced(written: Path, tmp_path: Path) -> None:
    for n in range(2):
        assert info(written)["epochs"][0]["known_cells"] > 1000
        assert show(written).any()
        export(written, tmp_path / f"{n}.egmap")
        assert info(tmp_path / f"{n}.egmap")["epochs"][0]["known_cells"] > 1000
        merge([Input.parse(str(written)), Input.parse(f"{tmp_path / f'{n}.egmap'}:1,1,5")], tmp_path / f"merged {n}.egmap")
    with pytest.raises(EchogridError, match="live.egmap: database is locked: it is not replaced, name another output"):
        export(tmp_path / "1.egmap", written, force=True)


# --- merge


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


# --- what goes wrong


@pytest.mark.parametrize(
    ("act", "complaint"),
    [
        (lambda p: info(p / "no.egmap"), "no.egmap: there is no such file"),
        (lambda p: info(p / "noise.egmap"), "noise.egmap: "),
        (lambda p: show(p / "map.tif"), "map.tif: its suffix tells no map format: expected .egmap, .npz, or the .yaml of a map_server map"),
        (lambda p: show(p / "map.npz", epoch=2), "map.npz: has no epochs, and --epoch 2 is given"),
        (lambda p: show(p / "car.egmap", epoch=7), "car.egmap: epoch 7 is not there, found 1, 3"),
        (lambda p: show(p / "empty.egmap"), "empty.egmap: not one cell of the map is known, so there is nothing to show"),
        (lambda p: show(p / "new.egmap"), "new.egmap: holds no map: not one epoch has begun"),
        (lambda p: show(p / "car.egmap", out=p / "no" / "a.png"), "no/a.png: there is no folder "),
        (
            lambda p: export(p / "car.egmap", p / "map.tif"),
            "map.tif: its suffix tells no format: expected one of .yaml, .png, .npz, .egmap, or --format",
        ),
        (lambda p: export(p / "car.egmap", p / "a.npz", mode="raw"), "a.npz: --mode raw is for map_server maps, and this is to be npz"),
        (lambda p: export(p / "car.egmap", p / "map.pgm", form="ros"), "map.pgm: a map_server map is named by its .yaml"),
        (lambda p: export(p / "car.egmap", p / "map.npz"), "map.npz: is there already: name another output, or give --force to replace it"),
        (lambda p: export(p / "car.egmap", p / "pic.yaml"), "pic.pgm: is there already"),
        (
            lambda p: export(p / "car.egmap", p / "car.egmap", force=True),
            "car.egmap: is to be read and written at once: name another output",
        ),
        (lambda p: export(p / "empty.egmap", p / "a.npz"), "empty.egmap: epoch 1: not one cell is known, so there is nothing to export"),
        (lambda p: export(p / "empty.egmap", p / "a.egmap"), "empty.egmap: epoch 1: not one tile is there to export"),
        (lambda p: parse_box("1,2,3"), "--bbox: found '1,2,3', expected X0,Y0,X1,Y1 in m with X0 < X1 and Y0 < Y1"),
        (lambda p: parse_box("1,2,0,3"), "--bbox: found '1,2,0,3', expected"),
        (lambda p: parse_box("1,2,inf,3"), "--bbox: found '1,2,inf,3', expected"),
        (lambda p: import_map(p / "map.npz", p / "a.npz"), "a.npz: expected a name that ends with .egmap"),
        (lambda p: import_map(p / "car.egmap", p / "a.egmap"), "car.egmap: its suffix tells no map format"),
        (
            lambda p: import_map(p / "unknown.npz", p / "a.egmap"),
            "unknown.npz: not one cell of the map is known, so there is nothing to import",
        ),
        (lambda p: import_map(p / "far.npz", p / "a.egmap"), "far.npz: origin: found 1e+12, 0, expected metres near the map"),
        (lambda p: Input.parse("map.npz"), "'map.npz': expected FILE.egmap[@EPOCH][:X,Y,YAW_DEG], metres and degrees"),
        (lambda p: Input.parse("map.egmap:1,2"), "'map.egmap:1,2': expected FILE.egmap"),
        (lambda p: Input.parse("map.egmap:1,2,nan"), "'map.egmap:1,2,nan': expected FILE.egmap"),
        (lambda p: merge([Input(p / "car.egmap", 3, SE2(0, 0, 0))], p / "a.npz"), "a.npz: expected a name that ends with .egmap"),
        (
            lambda p: merge([Input(p / "car.egmap", e, SE2(0, 0, 0)) for e in (3, 1)], p / "a.egmap"),
            "car.egmap: fusion: found sum, expected looks as in ",
        ),
        (lambda p: merge(both(p, "coarse"), p / "a.egmap"), "coarse.egmap: cells: found 0.5 m, expected 0.25 m as in "),
        (
            lambda p: merge(both(p, "other"), p / "a.egmap"),
            "other.egmap: calibration: found Calibration(learned=2.0, offset=0.0), expected ",
        ),
        (lambda p: merge(both(p, "many"), p / "a.egmap"), "many.egmap: radars: found 17 names in the maps up to here, expected at most 16"),
        (lambda p: merge(both(p, "damaged"), p / "a.egmap"), "damaged.egmap: tile (0, 0) of epoch 1 is damaged: "),
        (
            lambda p: merge(both(p, "car"), p / "a.egmap", scheduler="tcp://127.0.0.1:9"),
            "tcp://127.0.0.1:9: no Dask scheduler answers there within 0.2 s: ",
        ),
    ],
)
def test_every_mistake_is_one_sentence_and_nothing_is_written(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, act: Callable[[Path], object], complaint: str
) -> None:
    monkeypatch.setattr(merging, "PATIENCE", 0.2)
    (tmp_path / "noise.egmap").write_bytes(b"noise" * 1000)
    (tmp_path / "map.tif").write_bytes(b"")
    (tmp_path / "pic.pgm").write_bytes(b"")
    plane = np.zeros((2, 2), np.float32)
    for name, array, x in (("map", plane + 1, 0.0), ("unknown", plane, 0.0), ("far", plane + 1, 1e12)):
        np.savez(tmp_path / f"{name}.npz", log_odds=array, origin=np.array((x, 0.0)), cell=np.array(CELL))
    write_store(tmp_path / "empty.egmap", {})
    TileStore(tmp_path / "new.egmap", write=True).close()
    write_store(tmp_path / "coarse.egmap", {}, described(cell=0.5))
    write_store(tmp_path / "other.egmap", {}, Description(0, "car", CELL, "looks", 3.5, Calibration(2.0, 0.0), ()))
    write_store(tmp_path / "many.egmap", {}, described(names=tuple(f"radar {n}" for n in range(14))))
    write_store(tmp_path / "damaged.egmap", random_tiles(1, ((0, 0),)))
    with TileStore(tmp_path / "damaged.egmap", write=True) as store:
        store._connection.execute("UPDATE tile SET data = x'00'")
    before = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises(EchogridError) as caught:
        act(tmp_path)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith((str(tmp_path), "--bbox", "'map", "tcp://"))
    after = sorted(path.name for path in tmp_path.iterdir() if not path.name.endswith(("-shm", "-wal")))
    assert after == [name for name in before if not name.endswith(("-shm", "-wal"))]


def both(folder: Path, name: str) -> list[Input]:
    return [Input(folder / "car.egmap", 3, SE2(0, 0, 0)), Input(folder / f"{name}.egmap", None, SE2(0.1, 0, 0))]


def test_without_the_extra_a_cluster_is_refused(stored: Path, tmp_path: Path) -> None:
    program = "import sys; sys.modules['distributed'] = None; from echogrid.cli import main; main()"
    command = [sys.executable, "-c", program, "map", "merge", tmp_path / "a.egmap", stored, "--scheduler", "tcp://127.0.0.1:9"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (1, "echogrid: --scheduler: needs the extra 'cluster': pip install 'echogrid[cluster]'\n")


def test_the_limit_is_one_that_pillow_opens_without_a_warning() -> None:
    assert Image.MAX_IMAGE_PIXELS is not None
    assert MOST_CELLS <= Image.MAX_IMAGE_PIXELS
