"""Any part of the map by Zenoh query, answered one after the other beside the mapping."""

from __future__ import annotations

import logging
import math
import queue
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import msgspec
import zenoh

from echogrid.core.map.map_delta import Rectangle
from echogrid.core.map.tile import SIDE
from echogrid.core.map.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.topics.announcer import MAP_FRAME, occupancy_percent
from echogrid.topics.grids import Grid, encode_grid
from echogrid.topics.topic import FLEET, FULL, REGION, TILE
from echogrid.zenoh.attachment import encode_attachment, encode_version
from echogrid.zenoh.fleet import compress
from echogrid.zenoh.publisher import Publisher, key
from echogrid.zenoh.stream import encoding

log = logging.getLogger("echogrid")
MOST_CELLS = 1 << 22  # of one answer: 2048 x 2048 cells, so 4 MiB
MOST_WAITING = 16  # queries; further ones are refused
FARTHEST = 1e6  # m, or tiles, from odom's origin
PARAMETERS = {"bbox", "fmt", "epoch"}


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Of a map that is or was."""

    epoch: int
    stamp_ns: int  # when the newest of its cells was last in view, in whole seconds of Unix time; 0 if none ever was
    log_odds: LogOdds  # (H, W)


class Reader(Protocol):
    """What knows the maps, those on disk too."""

    def part(self, where: Rectangle, epoch: int | None) -> Part:
        """Any thread may read. `epoch`: None is the running map. Raises EchogridError if there is none with that number."""


class Regions:
    """Remembers the queries that wait. Zenoh's thread takes them in, one thread runs `run`."""

    def __init__(self, publisher: Publisher, cell: float, reader: Reader) -> None:
        self.cell = cell
        self.reader = reader
        self.vehicle, self.gid = publisher.vehicle, publisher.gid
        self.sequence = 0
        self.waiting: queue.Queue[zenoh.Query | None] = queue.Queue(MOST_WAITING)
        # Called in Zenoh's own thread: with a thread between them, a program that ends without closing would never end.
        take = zenoh.handlers.Callback(self._take, indirect=False)
        keys = (key(publisher.vehicle, REGION), key(publisher.vehicle, f"{TILE}/*/*"))
        self._queryables = [publisher.session.declare_queryable(name, take, complete=True) for name in keys]

    def run(self, stop: threading.Event) -> None:
        """Answers until `stop`. A query that cannot be answered gets the reason as its reply."""
        while not stop.is_set():
            query = self.waiting.get()
            if query is None:
                continue
            with query:  # the client waits for more until the query is dropped
                try:
                    self._answer(query)
                except EchogridError as error:
                    _refuse(query, str(error))
                except zenoh.ZError as error:
                    log.warning("a query could not be answered: %s", error)

    def wake(self) -> None:
        """So that `run` sees that it is to stop."""
        with suppress(queue.Full):  # then it is awake
            self.waiting.put_nowait(None)

    def _take(self, query: zenoh.Query) -> None:
        try:
            self.waiting.put_nowait(query)
        except queue.Full:
            with query:
                _refuse(query, f"{MOST_WAITING} queries are waiting already, ask again later")

    def _answer(self, query: zenoh.Query) -> None:
        parameters = dict(query.parameters.__iter__())
        unknown = sorted(set(parameters) - PARAMETERS)
        if unknown:
            raise EchogridError(f"{unknown[0]}: no such parameter, expected {', '.join(sorted(PARAMETERS))}")
        asked = str(query.key_expr)
        tile = asked.rpartition(f"/{TILE}/")[2] if f"/{TILE}/" in asked else None
        where = region_cells(parameters, self.cell) if tile is None else tile_cells(tile, parameters)
        packed = _packed(parameters)
        part = self.reader.part(where, _epoch(parameters))
        origin = (where.column * self.cell, where.row * self.cell)
        payload = encode_grid(Grid(part.stamp_ns, MAP_FRAME, self.cell, origin, occupancy_percent(part.log_odds)))
        self.sequence += 1
        attachment = encode_attachment(self.sequence, part.stamp_ns, self.gid) + encode_version(part.epoch, 0)
        kind = encoding(FLEET if packed else FULL)
        name = key(self.vehicle, REGION if tile is None else f"{TILE}/{tile}")  # the query's own may be that of many vehicles
        query.reply(name, compress(payload) if packed else payload, encoding=kind, attachment=attachment)


def region_cells(parameters: Mapping[str, str], cell: float) -> Rectangle:
    """The cells that a box in odom touches. Raises EchogridError if it is not a box, or too large."""
    box = parameters.get("bbox")
    expected = "expected x0,y0,x1,y1 in m with x0 < x1 and y0 < y1"
    if box is None:
        raise EchogridError(f"bbox: is missing, {expected}")
    try:
        x0, y0, x1, y1 = (float(number) for number in box.split(","))
    except ValueError:
        raise EchogridError(f"bbox: '{box[:80]}' found, {expected}") from None
    if not (-FARTHEST <= x0 < x1 <= FARTHEST and -FARTHEST <= y0 < y1 <= FARTHEST):
        raise EchogridError(f"bbox: '{box[:80]}' found, {expected}, all within {FARTHEST:g} m")
    row, column = math.floor(y0 / cell), math.floor(x0 / cell)
    where = Rectangle(row, column, math.ceil(y1 / cell) - row, math.ceil(x1 / cell) - column)
    if where.height * where.width > MOST_CELLS:
        raise EchogridError(f"bbox: {where.height} x {where.width} cells asked for, expected at most {MOST_CELLS} at once")
    return where


def tile_cells(name: str, parameters: Mapping[str, str]) -> Rectangle:
    """The cells of the tile of that name, row/column. Raises EchogridError if no tile has it."""
    if "bbox" in parameters:
        raise EchogridError("bbox: found with a tile, expected only in a query for a region")
    try:
        row, column = map(int, name.split("/"))
    except ValueError:
        raise EchogridError(f"{TILE}/{name[:80]}: expected row and column of one tile") from None
    if max(abs(row), abs(column)) > FARTHEST:
        raise EchogridError(f"{TILE}/{name[:80]}: is beyond every map")
    return Rectangle(row * SIDE, column * SIDE, SIDE, SIDE)


def _packed(parameters: Mapping[str, str]) -> bool:
    """Whether the answer is wanted in zstd."""
    value = parameters.get("fmt", "cdr")
    if value not in ("cdr", "zstd"):
        raise EchogridError(f"fmt: '{value[:80]}' found, expected cdr or zstd")
    return value == "zstd"


def _epoch(parameters: Mapping[str, str]) -> int | None:
    value = parameters.get("epoch")
    if value is not None and not (value.isascii() and value.isdigit() and len(value) < 10):
        raise EchogridError(f"epoch: '{value[:80]}' found, expected the number of a map")
    return None if value is None else int(value)


def _refuse(query: zenoh.Query, why: str) -> None:
    query.reply_err(msgspec.json.encode({"error": why}), encoding=zenoh.Encoding.APPLICATION_JSON)
