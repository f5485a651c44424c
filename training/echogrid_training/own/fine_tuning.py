"""A network that goes on learning from towns that are simulated as a car sees streets.

echogrid-train simulate --family train --towns 8 --like drives/* --out towns
echogrid-train adapt default drives/* --simulated towns --out mine.onnx

From the drives themselves it learns nothing: hindsight knows where detections lie, which the map knows better, and a network that is taught
so forgets what stands there (training/LOG.md). They say what the towns' radars are like, and whether it helped.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid_training.learning.dataset import Samples, find_drives, load_drives, split
from echogrid_training.recording import Track

EPOCHS, BATCH, RATE, PATIENCE = 4, 16, 5e-4, 2


def of_towns(folder: Path, track: Track) -> tuple[Samples, Samples]:
    """To learn from, and of other towns to stop by. Raises EchogridError."""
    drives = find_drives(folder)
    parts: list[Sequence[Path]] = list(split(drives))
    if not all(parts):
        raise EchogridError(f"{folder}: holds one town, expected two or more: one to learn from, one to stop by")
    learned, held_out = (load_drives(part, track) for part in parts)
    return learned, held_out


def tuned(
    parent: Path, learned: Samples, held_out: Samples, out: Path, calibration: Calibration, *, seed: int, epochs: int, track: Track
) -> list[Path]:
    """Goes on from the float file `parent`; the float and the int8 file. Raises EchogridError."""
    from echogrid_training.learning import export, fit, train, warm_start  # PyTorch is loaded when it runs, not before

    settings = train.Settings("default", epochs=epochs, seed=seed, batch=BATCH, rate=RATE)
    start = warm_start.started(parent, learned)
    trained = train.fit(learned, held_out, settings, out / "run", track=track, start=start, patience=PATIENCE)
    return export.export(trained, out / "tuned", calibration, fit.calibrating(learned))
