"""What a store holds."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

from echogrid.maps.files import open_store
from echogrid.maps.stored_epoch import OnProgress, StoredEpoch, part
from echogrid.store.store_file import VERSION


def info(path: Path, on_progress: OnProgress | None = None) -> dict[str, Any]:
    """For programs; `lines` makes it readable. Lengths in m, times in Unix seconds, null where nothing is known. Raises EchogridError."""
    with open_store(path) as store:
        numbers = [epoch.id for epoch in store.epochs()]
        epochs = [_epoch(StoredEpoch(store, number), part(on_progress, n, len(numbers))) for n, number in enumerate(numbers)]
    size = sum(one.stat().st_size for one in (path, path.with_name(f"{path.name}-wal")) if one.exists())
    return {"file": str(path), "version": VERSION, "bytes": size, "epochs": epochs}


def lines(document: dict[str, Any], now_s: float) -> list[str]:
    """`info` for people. `now_s`: Unix time, from which ages are counted."""
    count = len(document["epochs"])
    out = [f"{document['file']}: version {document['version']}, {count} epoch{'s' * (count != 1)}, {_size(document['bytes'])}"]
    for epoch in document["epochs"]:
        out += ["", f"epoch {epoch['epoch']}: vehicle '{epoch['vehicle']}', started {_utc(epoch['begun_s'])}"]
        out.append(f"  fusion   {epoch['kind']}, cells of {epoch['cell_m']:g} m")
        out.append(f"  tiles    {epoch['tiles']}, {_size(epoch['bytes'])}")
        measured = f", {epoch['measured_cells']} of them measured, the others learned only" if epoch["kind"] == "looks" else ""
        out.append(f"  cells    {epoch['known_cells']} known{measured}; {epoch['area_m2']:.0f} m²")
        if epoch["bounds_m"] is not None:
            x0, y0, x1, y1 = epoch["bounds_m"]
            out.append(f"  bounds   x {x0:.1f} … {x1:.1f} m, y {y0:.1f} … {y1:.1f} m")
        if epoch["newest_s"] is not None:
            newest, oldest = (f"{_utc(at)} ({_age(now_s - at)})" for at in (epoch["newest_s"], epoch["oldest_s"]))
            out.append(f"  in view  newest cell {newest}, oldest {oldest}")
        out.append(f"  radars   {', '.join(epoch['radars']) or 'not known'}")
    return out


def _epoch(stored: StoredEpoch, on_progress: OnProgress | None) -> dict[str, Any]:
    what, extent = stored.description, stored.extent(on_progress)
    known, cell = extent.known, what.cell
    edges = (known.column, known.row, known.column + known.width, known.row + known.height)
    return {
        "epoch": stored.number,
        "begun_s": what.begun_ns / 1e9,
        "vehicle": what.vehicle,
        "kind": what.kind,
        "cell_m": cell,
        "tiles": len(stored.keys),
        "bytes": stored.bytes,
        "known_cells": extent.known_cells,
        "measured_cells": extent.measured_cells,
        "area_m2": round(extent.known_cells * cell * cell, 3),
        "bounds_m": [edge * cell for edge in edges] if extent.known_cells else None,
        "oldest_s": extent.oldest_s,
        "newest_s": extent.newest_s,
        "radars": list(what.radars),
    }


def _utc(seconds: float) -> str:
    try:
        return datetime.datetime.fromtimestamp(seconds, datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (OverflowError, ValueError):  # not a valid stamp; years end at 9999
        return f"{seconds:.0f} s after 1970"


def _age(seconds: float) -> str:
    """Of what another clock has stamped, or this one before it was set, it may be less than none."""
    when = "ago" if seconds > -1 else "ahead of this computer's clock"
    for unit, length in (("days", 86400), ("h", 3600), ("min", 60)):
        if abs(seconds) >= 2 * length:
            return f"{abs(seconds) / length:.0f} {unit} {when}"
    return f"{abs(seconds):.0f} s {when}"


def _size(count: int) -> str:
    return f"{count / 2**20:.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"
