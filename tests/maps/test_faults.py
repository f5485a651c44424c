"""Mistakes with stored maps are one sentence each, and another process may write the store meanwhile."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.support.stores import CELL, described, random_tiles, write_store

from echogrid.core.map.look_map import Calibration
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.maps import cluster
from echogrid.maps.export import export, parse_box
from echogrid.maps.importing import import_map
from echogrid.maps.info import info
from echogrid.maps.merge import Input, merge
from echogrid.maps.show import show
from echogrid.store.epoch import Description
from echogrid.store.tile_store import TileStore

WRITER = """
import sys
from pathlib import Path
from tests.support.stores import described, random_tiles
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
    with pytest.raises(EchogridError, match="live.egmap: database is locked: it was not replaced, name another output"):
        export(tmp_path / "1.egmap", written, force=True)


def both(folder: Path, name: str) -> list[Input]:
    return [Input(folder / "car.egmap", 3, SE2(0, 0, 0)), Input(folder / f"{name}.egmap", None, SE2(0.1, 0, 0))]


@pytest.mark.parametrize(
    ("act", "complaint"),
    [
        (lambda p: info(p / "no.egmap"), "no.egmap: there is no such file"),
        (lambda p: info(p / "noise.egmap"), "noise.egmap: "),
        (lambda p: info(p), ": is a folder, expected a file such as "),
        (lambda p: show(p), ": is a folder, expected a file such as "),
        (lambda p: show(p / "map.tif"), "map.tif: no map format has its suffix: expected .egmap, .npz, or the .yaml of a map_server map"),
        (lambda p: info(p / "map.npz"), "map.npz: is no store, expected a .egmap file: `echogrid map import` makes one of it"),
        (lambda p: show(p / "car.egmap", out=p / "a.jpg"), "a.jpg: is not written, expected a name that ends in .png"),
        (lambda p: show(p / "map.npz", epoch=2), "map.npz: has no epochs, and --epoch 2 is given"),
        (lambda p: show(p / "car.egmap", epoch=7), "car.egmap: epoch 7 is not there, found 1, 3"),
        (lambda p: show(p / "empty.egmap"), "empty.egmap: no cell of the map is known, so there is nothing to show"),
        (lambda p: show(p / "new.egmap"), "new.egmap: holds no map: it has no epoch"),
        (lambda p: show(p / "car.egmap", out=p / "no" / "a.png"), "no/a.png: there is no folder "),
        (
            lambda p: export(p / "car.egmap", p / "map.tif"),
            "map.tif: no format has its suffix: expected one of .yaml, .png, .npz, .egmap, or --format",
        ),
        (lambda p: export(p / "car.egmap", p / "a.npz", mode="raw"), "a.npz: --mode raw is for map_server maps, not for npz"),
        (lambda p: export(p / "car.egmap", p / "map.pgm", form="ros"), "map.pgm: name a map_server map by its .yaml"),
        (lambda p: export(p / "car.egmap", p / "map.npz"), "map.npz: exists already: name another output, or give --force to replace it"),
        (lambda p: export(p / "car.egmap", p / "pic.yaml"), "pic.pgm: exists already"),
        (
            lambda p: export(p / "car.egmap", p / "car.egmap", force=True),
            "car.egmap: would be read and written at once: name another output",
        ),
        (lambda p: export(p / "empty.egmap", p / "a.npz"), "empty.egmap: epoch 1: no cell is known, so there is nothing to export"),
        (lambda p: export(p / "empty.egmap", p / "a.egmap"), "empty.egmap: epoch 1: there is no tile to export"),
        (lambda p: export(p / "car.egmap", p / "a.png", box=(9e5, 9e5, 9e5 + 1, 9e5 + 1)), ": there is no tile of it in --bbox"),
        (lambda p: parse_box("1,2,3"), "--bbox: found '1,2,3', expected X0,Y0,X1,Y1 in m with X0 < X1 and Y0 < Y1"),
        (lambda p: parse_box("1,2,0,3"), "--bbox: found '1,2,0,3', expected"),
        (lambda p: parse_box("1,2,inf,3"), "--bbox: found '1,2,inf,3', expected"),
        (lambda p: import_map(p / "map.npz", p / "a.npz"), "a.npz: expected a name that ends with .egmap"),
        (lambda p: import_map(p / "car.egmap", p / "a.egmap"), "car.egmap: is a store already, expected .npz"),
        (
            lambda p: import_map(p / "unknown.npz", p / "a.egmap"),
            "unknown.npz: no cell of the map is known, so there is nothing to import",
        ),
        (lambda p: import_map(p / "far.npz", p / "a.egmap"), "far.npz: origin: found 1e+12, 0, expected metres near the map"),
        (lambda p: Input.parse("map.npz"), "'map.npz': expected FILE.egmap[@EPOCH][:X,Y,YAW_DEG], metres and degrees"),
        (lambda p: Input.parse("map.egmap:1,2"), "'map.egmap:1,2': expected FILE.egmap"),
        (lambda p: Input.parse("map.egmap:1,2,nan"), "'map.egmap:1,2,nan': expected FILE.egmap"),
        (lambda p: merge([Input(p / "car.egmap", 3, SE2(0, 0, 0))], p / "a.npz"), "a.npz: expected a name that ends with .egmap"),
        (
            lambda p: merge([Input(p / "car.egmap", e, SE2(0, 0, 0)) for e in (3, 1)], p / "a.egmap"),
            "car.egmap@1: fusion: found sum, expected looks as in ",
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
    monkeypatch.setattr(cluster, "PATIENCE", 0.2)
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


def test_a_folder_is_told_a_file_that_the_command_takes(tmp_path: Path) -> None:
    (tmp_path / "a.npz").touch()
    with pytest.raises(EchogridError, match="is a folder, expected a file$"):
        info(tmp_path)
    with pytest.raises(EchogridError, match=r"is a folder, expected a file such as .*a\.npz$"):
        show(tmp_path)


def test_a_store_that_is_closed_to_this_user_is_called_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one of a service is that runs as a user of its own; root, who runs tests in places, may read all."""
    write_store(tmp_path / "a.egmap", {})
    monkeypatch.setattr("os.access", lambda path, mode: False)
    with pytest.raises(EchogridError, match=r"a\.egmap: cannot be read: Permission denied$"):
        info(tmp_path / "a.egmap")
