"""Which inverse sensor model runs: of a shipped network the file that is right on this machine, and fast."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from echogrid.core.evidence.history_raster import CHANNELS
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.model.network import PAPER, OnnxSensorModel

SHIPPED = ("default", "paper")
RUNS = 5  # that a file is timed by
CLEARLY = 0.7  # of the first file's time: nearer ones may be noise, and the same machine must choose the same file each time


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A model, and why it is this file: one sentence for log and status."""

    model: OnnxSensorModel
    why: str


def choose(name: str, spec: GridSpec, mounts: Mapping[str, Mount], sha256: str | None = None) -> Choice:
    """`name` is one of SHIPPED or the path of a file, which must then have that SHA-256, if one is given.

    Raises EchogridError if none of the files passes its checks.
    """
    if name in SHIPPED:
        return choose_file(shipped(name), spec, mounts, sums())
    model = OnnxSensorModel(Path(name), spec, mounts, sha256)
    return Choice(model, f"{model.path.name}, as configured, SHA-256 {model.sha256}")


def folder() -> Path:
    """The folder of the shipped models."""
    return Path(str(files("echogrid") / "models"))


def sums() -> dict[str, str]:
    """SHA-256 of each shipped file by its name, from the list beside them: a file that was exchanged or torn is not run."""
    lines = (folder() / "SHA256SUMS").read_text(encoding="ascii").splitlines()
    return {name: digest for digest, name in (line.split() for line in lines)}


def shipped(name: str) -> list[Path]:
    """Files of a shipped network: int8 first, where there is one."""
    int8 = folder() / f"{name}.int8.onnx"
    return [*([int8] if int8.exists() else []), folder() / f"{name}.onnx"]


def choose_file(paths: list[Path], spec: GridSpec, mounts: Mapping[str, Mount], sums: Mapping[str, str] | None = None) -> Choice:
    """The first of the files that give their golden answers on this machine, or a later one that is clearly faster here.

    `sums`: the SHA-256 that a file of each name must have; None: any.
    """
    sound: list[OnnxSensorModel] = []
    wrong: list[EchogridError] = []
    for path in reversed(paths):  # the last is mostly given up, and what is loaded after it takes its place in memory
        try:
            expected = None if sums is None else sums.get(path.name, "one that SHA256SUMS lists")
            sound.insert(0, OnnxSensorModel(path, spec, mounts, expected))
        except EchogridError as error:
            wrong.insert(0, error)
    if not sound:
        raise wrong[-1]
    times = measure(sound)
    fastest = int(np.argmin(times))
    best = sound[fastest if times[fastest] < CLEARLY * times[0] else 0]
    said = [f"{model.path.name} {seconds * 1e3:.1f} ms" for model, seconds in zip(sound, times, strict=True)]
    why = f"{best.path.name}, by {', '.join(said)}, SHA-256 {best.sha256}"
    return Choice(best, why + "".join(f"; {error}" for error in wrong))


def measure(models: list[OnnxSensorModel]) -> list[float]:
    """Median seconds of a run of each, in turns, so that what else the machine does strikes all alike."""
    times: list[list[float]] = [[] for _ in models]
    images = [np.zeros((len(PAPER if m.contract.channels == PAPER else CHANNELS), m.spec.cells, m.spec.cells), np.uint8) for m in models]
    for _ in range(RUNS):
        for model, image, spent in zip(models, images, times, strict=True):
            began = time.perf_counter()
            model.run(image)
            spent.append(time.perf_counter() - began)
    return [statistics.median(spent) for spent in times]
