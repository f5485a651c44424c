"""A disk that is full before a file ends: it is said, with the file's own name, and no file is there in part."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.support import disk

from echogrid.core.map.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.maps import map_server
from echogrid.maps.export import export
from echogrid.maps.importing import import_map
from echogrid.maps.map_files import FILES, write_map
from echogrid.maps.merge import Input, merge


def noise(side: int) -> LogOdds:
    """Cells that no format makes much smaller."""
    return np.random.default_rng(0).normal(size=(side, side)).astype(np.float32)


@pytest.fixture
def room() -> Iterator[Callable[[int], None]]:
    """From its call on no file may have more bytes: as on a full disk there is a short write, and then an error."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda most: resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("most", [0, 100, 5_000, 40_000])
def test_no_picture_of_a_map_is_there_in_part(tmp_path: Path, room: Callable[[int], None], most: int) -> None:
    """40,000 bytes hold a PGM's last piece but for some, which one write of several would leave out."""
    for mode in map_server.MODES:
        pixels = map_server.pixels_of(noise(201), mode)
        room(most)
        with pytest.raises(OSError, match="File too large") as failed:
            map_server.write(tmp_path / "map.yaml", pixels, (0.0, 0.0), 0.2, mode)
        room(resource.RLIM_INFINITY)
        assert str(failed.value.filename).startswith(str(tmp_path / "map."))
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("most", [0, 100, 2_000, 60_000])
def test_no_file_of_a_replay_is_there_in_part(tmp_path: Path, room: Callable[[int], None], most: int) -> None:
    cells = noise(200)
    occupancy = SimpleNamespace(whole=lambda: (0, 0, cells), bounds=lambda: (0, 0, 200, 200), spec=SimpleNamespace(cell=0.2))
    stamps, poses = np.arange(500), np.random.default_rng(1).normal(size=(500, 3))
    write_map(tmp_path, occupancy, stamps, poses)  # type: ignore[arg-type]
    whole = {name: (tmp_path / name).read_bytes() for name in FILES}
    for name in FILES:
        (tmp_path / name).unlink()
    room(most)
    with pytest.raises(OSError, match="File too large"):
        write_map(tmp_path, occupancy, stamps, poses)  # type: ignore[arg-type]
    room(resource.RLIM_INFINITY)
    assert {path.name for path in tmp_path.iterdir()} < set(FILES)
    assert all(path.read_bytes() == whole[path.name] for path in tmp_path.iterdir())


def test_a_store_that_has_no_room_is_said_by_its_own_name(stored: Path, tmp_path: Path) -> None:
    """And not by that under which it is written."""
    export(stored, tmp_path / "map.npz")
    with disk.small(tmp_path / "disk", kib=16) as folder:
        out = folder / "new.egmap"
        for write in (
            lambda: export(stored, out),
            lambda: import_map(tmp_path / "map.npz", out),
            lambda: merge([Input.parse(str(stored)), Input.parse(f"{stored}:1,1,5")], out),
        ):
            with pytest.raises(EchogridError) as failed:
                write()
            assert str(failed.value) in (f"{out}: database or disk is full", f"{out}: the disk is full")
            assert not list(folder.iterdir())
