"""Parts of the map by query: real sessions, a map that is being made, and one that is on disk."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import numpy as np
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from tests.support import world
from tests.support.one_by_one import mapped
from tests.support.waiting import PATIENCE, until

from echogrid.can.intake.frames import FrameBatch
from echogrid.client import Client
from echogrid.config.loading import load_config
from echogrid.config.tables import Publish, Ros
from echogrid.core.map.map_delta import Rectangle
from echogrid.core.map.tile import SIDE
from echogrid.errors import EchogridError
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import occupancy_percent
from echogrid.topics.grids import decode_grid
from echogrid.zenoh.map_reader import MapReader
from echogrid.zenoh.publisher import Publisher, session_config
from echogrid.zenoh.region import MOST_CELLS, MOST_WAITING, Regions, region_cells, tile_cells

CELL = 30.0 / 128  # m
REGION = "echogrid/v1/test/grid/fused/region"
TILE = "echogrid/v1/test/grid/fused/tile"


@pytest.fixture(scope="module")
def messages() -> list[can.Message]:
    walls = [world.standing([(x, y) for x in np.arange(-10, 60, 0.7).tolist()]) for y in (-6.0, 5.0)]
    return world.record(world.straight(12.0), walls, 3.0)


@pytest.fixture
def pipeline(tmp_path: Path) -> Pipeline:
    path = world.write_drive(tmp_path, []) / "echogrid.toml"
    return Pipeline(load_config(path), path)


@contextmanager
def answering(endpoint: str, reader: MapReader, *, running: bool = True) -> Iterator[Regions]:
    """What takes queries in, and unless told otherwise the thread that answers them."""
    stop = threading.Event()
    with Publisher(Publish(listen=(endpoint,)), "test", Ros()) as publisher:
        regions = Regions(publisher, CELL, reader)
        thread = threading.Thread(target=regions.run, args=(stop,))
        if running:
            thread.start()
        try:
            yield regions
        finally:
            stop.set()
            regions.wake()
            if thread.ident is not None:
                thread.join()


def ask(session: zenoh.Session, selector: str) -> list[zenoh.Reply]:
    """The replies; asks again while nobody is there."""
    return until(lambda: list(session.get(selector, timeout=PATIENCE)))


def refusal(session: zenoh.Session, selector: str) -> str:
    (reply,) = ask(session, selector)
    assert reply.err is not None, selector
    assert str(reply.err.encoding) == "application/json"
    told = json.loads(bytes(reply.err.payload))
    assert told.keys() == {"error"}
    return str(told["error"])


def test_a_region_is_the_map_there_whole_and_packed(endpoint: str, pipeline: Pipeline, messages: list[can.Message]) -> None:
    for _ in pipeline.updates([FrameBatch.of(messages)]):
        pass
    occupancy, mapper = pipeline.mapper.map, pipeline.mapper
    with answering(endpoint, MapReader(mapper, threading.Lock(), None)), Client(endpoint, "test") as client:
        until_there(client)
        for box in ((-20.0, -10.0, 45.0, 9.9), (3.0, 4.9, 3.01, 5.2), (-1000.0, -10.0, -900.0, -9.0), (29.9, -40.0, 30.1, 40.0)):
            window = client.region(box, timeout=PATIENCE)
            assert window is not None
            x0, y0, x1, y1 = box
            row, column = round(window.origin[1] / CELL), round(window.origin[0] / CELL)
            height, width = window.occupancy.shape
            assert window.origin == pytest.approx((column * CELL, row * CELL))
            assert window.origin[0] <= x0 < window.origin[0] + CELL
            assert window.origin[1] <= y0 < window.origin[1] + CELL
            assert window.origin[0] + (width - 1) * CELL < x1 <= window.origin[0] + width * CELL + 1e-9
            assert window.origin[1] + (height - 1) * CELL < y1 <= window.origin[1] + height * CELL + 1e-9
            np.testing.assert_array_equal(window.occupancy, occupancy_percent(occupancy.window(row, column, height, width)))
            assert window.map.epoch == 0
            newest = mapper.odometry.states[-1].stamp_ns
            known = (window.occupancy >= 0).any()
            assert window.stamp_ns == 0 if not known else 0 <= newest - window.stamp_ns < 3e9
        with zenoh.open(session_config((), (endpoint,), sends=False)) as session:
            (whole,) = ask(session, f"{REGION}?bbox=-5,-5,5,5")
            (packed,) = ask(session, f"{REGION}?fmt=zstd;bbox=-5,-5,5,5")
            (tile,) = ask(session, f"{TILE}/-1/0")
        assert str(whole.ok.encoding) == "application/cdr;nav_msgs/msg/OccupancyGrid"
        assert str(packed.ok.encoding) == "application/cdr+zstd;nav_msgs/msg/OccupancyGrid"
        assert len(bytes(packed.ok.payload)) < 0.6 * len(bytes(whole.ok.payload))
        grid = decode_grid(bytes(tile.ok.payload))
        assert grid.origin == (0.0, -SIDE * CELL)
        np.testing.assert_array_equal(grid.occupancy, occupancy_percent(occupancy.window(-SIDE, 0, SIDE, SIDE)))
        assert (grid.occupancy > 80).any()


def until_there(client: Client) -> None:
    until(lambda: client.region((0.0, 0.0, 1.0, 1.0)))


def test_while_the_map_is_made_every_answer_is_the_map_of_a_moment(endpoint: str, pipeline: Pipeline, messages: list[can.Message]) -> None:
    """A part within one tile is never half of one update and half of the next."""
    lock, moments = threading.Lock(), set[bytes]()
    where = region_cells({"bbox": "2,1,28,28"}, CELL)

    def make() -> None:
        with lock:
            moments.add(occupancy_percent(pipeline.mapper.map.window(*where)).tobytes())
        for message in messages:
            with lock:
                if mapped(pipeline, "can0", message):
                    moments.add(occupancy_percent(pipeline.mapper.map.window(*where)).tobytes())

    with answering(endpoint, MapReader(pipeline.mapper, lock, None)), Client(endpoint, "test") as client:
        until_there(client)
        maker = threading.Thread(target=make)
        answers = []
        while maker.is_alive() or len(answers) < 3:
            window = client.region((2.0, 1.0, 28.0, 28.0), timeout=PATIENCE)
            assert window is not None
            answers.append(window.occupancy.tobytes())
            if maker.ident is None:
                maker.start()
        maker.join()
    assert set(answers) <= moments
    assert len(set(answers)) > 1


def test_an_older_map_is_read_from_the_store(endpoint: str, tmp_path: Path, pipeline: Pipeline, messages: list[can.Message]) -> None:
    lock = threading.Lock()
    with pipeline.keep(tmp_path / "map.egmap", 1, lock) as keeper:
        for _ in pipeline.updates([FrameBatch.of(messages)]):
            pass
        pipeline.mapper.end_cycle()
        first = pipeline.mapper.epoch
        before = occupancy_percent(pipeline.mapper.map.window(-30, -40, 60, 200))
        keeper.flush()
        pipeline.mapper._start_new_map("as after a gap in the ego motion", pipeline.mapper.map.stamp_ns)
        with answering(endpoint, MapReader(pipeline.mapper, lock, keeper)), Client(endpoint, "test") as client:
            until_there(client)
            box = (-40 * CELL, -30 * CELL, 160 * CELL, 30 * CELL)
            old, now = (client.region(box, epoch, timeout=PATIENCE) for epoch in (first, None))
            assert old is not None
            assert now is not None
            assert (old.map.epoch, now.map.epoch) == (first, first + 1)
            np.testing.assert_array_equal(old.occupancy, before)
            assert (before > 80).any()
            assert (now.occupancy == -1).all()
            with pytest.raises(EchogridError, match=rf"epoch: 77 found, expected {first}, {first + 1}$"):
                client.region(box, epoch=77)


@pytest.mark.parametrize(
    ("selector", "said"),
    [
        (REGION, "bbox: is missing, expected x0,y0,x1,y1"),
        (f"{REGION}?bbox=", "bbox: '' found, expected x0,y0,x1,y1 in m with x0 < x1 and y0 < y1"),
        (f"{REGION}?bbox=1,2,3", "bbox: '1,2,3' found"),
        (f"{REGION}?bbox=0,0,nan,1", "bbox: '0,0,nan,1' found"),
        (f"{REGION}?bbox=0,0,inf,1", "bbox: '0,0,inf,1' found"),
        (f"{REGION}?bbox=0,0,0,1", "bbox: '0,0,0,1' found"),
        (f"{REGION}?bbox=0,0,1,2e6", "all within 1e+06 m"),
        (f"{REGION}?bbox=-900,-900,900,900", f"expected at most {MOST_CELLS} at once"),
        (f"{REGION}?bbox=0,0,1,1;fmt=png", "fmt: 'png' found, expected cdr or zstd"),
        (f"{REGION}?bbox=0,0,1,1;colour=red", "colour: no such parameter, expected bbox, epoch, fmt"),
        (f"{REGION}?bbox=0,0,1,1;epoch=-1", "epoch: '-1' found, expected the number of a map"),
        (f"{REGION}?bbox=0,0,1,1;epoch=3", "epoch: 3 found, expected 0: this service stores no maps"),
        (f"{TILE}/1/x", "grid/fused/tile/1/x: expected row and column of one tile"),
        (f"{TILE}/*/*", "grid/fused/tile/*/*: expected row and column of one tile"),
        (f"{TILE}/**", "grid/fused/tile/**: expected row and column of one tile"),
        (f"{TILE}/1/99999999999", "is beyond every map"),
        (f"{TILE}/1/1?bbox=0,0,1,1", "bbox: found with a tile"),
    ],
)
def test_what_cannot_be_answered_is_told_in_a_sentence(endpoint: str, pipeline: Pipeline, selector: str, said: str) -> None:
    reader = MapReader(pipeline.mapper, threading.Lock(), None)
    with answering(endpoint, reader), zenoh.open(session_config((), (endpoint,), sends=False)) as session:
        assert said in refusal(session, selector)


def test_more_queries_than_may_wait_are_told_to_come_again(endpoint: str, pipeline: Pipeline) -> None:
    reader = MapReader(pipeline.mapper, threading.Lock(), None)
    with answering(endpoint, reader, running=False) as regions, zenoh.open(session_config((), (endpoint,), sends=False)) as session:
        querier = session.declare_querier(REGION, timeout=PATIENCE)
        until(lambda: querier.matching_status.matching)  # it is known whom to ask
        handlers = [querier.get(parameters="bbox=0,0,1,1") for _ in range(MOST_WAITING + 4)]
        replies: list[zenoh.Reply | None] = [None] * len(handlers)

        def refused() -> list[str]:
            replies[:] = [reply or handler.try_recv() for reply, handler in zip(replies, handlers, strict=True)]
            return [json.loads(bytes(reply.err.payload))["error"] for reply in replies if reply is not None]

        until(lambda: len(refused()) == 4)
        assert set(refused()) == {f"{MOST_WAITING} queries are waiting already, ask again later"}
        assert regions.waiting.full()
        stop = threading.Event()
        thread = threading.Thread(target=regions.run, args=(stop,))
        thread.start()
        answered = [handler.recv() for reply, handler in zip(replies, handlers, strict=True) if reply is None]
        stop.set()
        regions.wake()
        thread.join()
        assert sum(reply.ok is not None for reply in answered) == MOST_WAITING


@given(st.text(max_size=40), st.text(max_size=20))
def test_whatever_is_asked_for_is_cells_or_a_sentence(box: str, tile: str) -> None:
    for read in (lambda: region_cells({"bbox": box}, CELL), lambda: tile_cells(tile, {})):
        with suppress(EchogridError):
            where = read()
            assert 0 < where.height * where.width <= MOST_CELLS


@given(st.tuples(*[st.floats(-1e5, 1e5)] * 2), st.tuples(*[st.floats(1e-3, 400)] * 2))
def test_a_box_is_the_cells_that_it_touches(corner: tuple[float, float], size: tuple[float, float]) -> None:
    x0, y0 = corner
    x1, y1 = x0 + size[0], y0 + size[1]
    where = region_cells({"bbox": f"{x0!r},{y0!r},{x1!r},{y1!r}"}, CELL)
    assert isinstance(where, Rectangle)
    for first, count, low, high in ((where.column, where.width, x0, x1), (where.row, where.height, y0, y1)):
        assert first <= low / CELL < first + 1
        assert first + count - 1 < high / CELL <= first + count
        assert math.isclose(count, (high - low) / CELL, abs_tol=2)
