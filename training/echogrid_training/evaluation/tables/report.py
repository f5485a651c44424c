"""What `evaluate sim` leaves behind: results.json, results.md and pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from echogrid_training.evaluation.simulated.judging import Judged
from echogrid_training.evaluation.tables import pictures, table

PICTURED = 6  # drives
PLOTTED = ("patch", "around", "finished")


def write(found: dict[str, Any], judged: Sequence[Judged], out: Path, elsewhere: Path | None) -> str:
    """Into `out`, which is made, and results.json `elsewhere` if given; returns the tables. Raises OSError."""
    said = table.tables(found)
    out.mkdir(parents=True, exist_ok=True)
    (elsewhere or out / "results.json").write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    (out / "results.md").write_text(said, "utf-8")
    for one in judged[:PICTURED]:
        if one.patch is not None:
            pictures.windows(one.patch).save(out / f"patch-{one.drive}.png")
    if judged[0].finished is not None:
        pictures.windows(judged[0].finished).save(out / f"finished-{judged[0].drive}.png")
    for level in [level for level in PLOTTED if level in found["levels"]]:
        pictures.reliability_plot(found["levels"][level], level).save(out / f"reliability-{level}.png")
    return said
