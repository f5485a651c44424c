"""Networks as the service runs them, from their files: as a method for single patches, and as what fills a map by either rule.

Beside them the paper's autoencoder on the lidar's image, straight from its training.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import onnx
import torch

from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import Bytes, HistoryRaster
from echogrid.core.evidence.raster import Image
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.model.network import KEY, PAPER, OnnxSensorModel, Planes
from echogrid_training.evaluation.simulated.baselines import Answer
from echogrid_training.evaluation.simulated.patches import Patch
from echogrid_training.learning.dataset import SPEC, of_lidar
from echogrid_training.learning.train import load_trained
from echogrid_training.learning.unet import evenly

Key = tuple[str, int]  # a method's name, and which of its seeds


class Learned(msgspec.Struct):
    """What of a file's metadata says how common the classes were."""

    class_shares: tuple[float, float, float]  # free, unknown, occupied


@dataclass(frozen=True)
class File:
    """One trained network, .onnx or, for the lidar's, .pt; files of one name are the same network from other seeds."""

    name: str
    path: Path

    def shares(self) -> tuple[float, float, float]:
        """Of the classes in what was learned from. Raises EchogridError where the file does not say."""
        held = {prop.key: prop.value for prop in onnx.load(self.path, load_external_data=False).metadata_props}
        try:
            return msgspec.json.decode(held[KEY], type=Learned).class_shares
        except (KeyError, msgspec.DecodeError) as error:
            raise EchogridError(f"{self.path}: metadata '{KEY}' does not say the class_shares that echogrid-train fit writes") from error


def numbered(files: Iterable[File]) -> list[tuple[Key, File]]:
    """Files of the same name by their number."""
    seen: dict[str, int] = {}
    out = []
    for file in files:
        out.append(((file.name, seen.get(file.name, 0)), file))
        seen[file.name] = seen.get(file.name, 0) + 1
    return out


class Artist:
    """Draws the twelve planes; remembers the last ones, since most methods ask for the same at every update."""

    def __init__(self, mounts: Mapping[str, Mount]) -> None:
        self._raster = HistoryRaster(SPEC, mounts)
        self._around: Surroundings | None = None
        self._image: Bytes = np.empty(0, dtype=np.uint8)

    def __call__(self, around: Surroundings) -> Bytes:
        """(12, H, W)"""
        if self._around is None or not same(around, self._around):
            self._around, self._image = around, self._raster(around)
        return self._image


def same(one: Surroundings, other: Surroundings) -> bool:
    """Whether both say the same: detections that lie at the very same points are the same ones."""
    pairs = ((one.now.points, other.now.points), (one.past.points, other.past.points), (one.age, other.age))
    looks = np.array_equal(one.looks.place, other.looks.place)
    return looks and one.live == other.live and all(np.array_equal(mine, theirs) for mine, theirs in pairs)


class Network:
    """Remembers its last image and answer: maps by both rules mostly ask for the same."""

    def __init__(self, file: File, mounts: Mapping[str, Mount], artist: Artist) -> None:
        """Raises EchogridError."""
        self.shares = torch.tensor(file.shares())
        self.model = OnnxSensorModel(file.path, SPEC, mounts)
        self._artist = artist
        self._image: Bytes | None = None
        self._said: Planes = np.empty(0, dtype=np.float32)

    def __call__(self, around: Surroundings) -> Planes:
        """(2, H, W) log-odds and weight, as io.model.OnnxSensorModel."""
        image = self._draw(around)
        if self._image is None or not np.array_equal(image, self._image):
            self._image, self._said = image, self.model.answer(image)
        return self._said

    def answer(self, patch: Patch) -> Answer:
        """The label is the class logits' mean under equally common classes, or tanh of half the log-odds."""
        planes = self.model.run(self._draw(patch.around))
        if self.model.contract.output == "log-odds":
            return Answer.of_log_odds(planes[0])
        label: Image = evenly(torch.from_numpy(planes)[None], self.shares)[0].numpy()
        return Answer(planes[2] - planes[0], label)

    def _draw(self, around: Surroundings) -> Bytes:
        return self.model.draw(around) if self.model.contract.channels == PAPER else self._artist(around)


class LidarNetwork:
    """The paper's autoencoder on one turn of the lidar, for single patches; no map is made of it."""

    def __init__(self, file: File) -> None:
        """Raises EchogridError where the file is not of a network that is shown the lidar's image."""
        trained = load_trained(file.path)
        if trained.settings.sensor != "lidar":
            raise EchogridError(f"{file.path}: is a network of the {trained.settings.sensor}'s image, expected the lidar's")
        self._recipe, self._model = trained.recipe(), trained.model()

    @torch.inference_mode()
    def answer(self, patch: Patch) -> Answer:
        """As Network.answer."""
        packed = np.packbits(patch.lidar.reshape(1, -1), axis=1)
        return Answer.of_log_odds(self._recipe.log_odds(self._model(torch.from_numpy(of_lidar(packed))))[0].numpy())


def networks(files: Iterable[File], mounts: Mapping[str, Mount]) -> dict[Key, Network]:
    """Those that the service can run, for one car. Raises EchogridError."""
    artist = Artist(mounts)
    return {key: Network(file, mounts, artist) for key, file in numbered(files) if file.path.suffix == ".onnx"}


def lidar_networks(files: Iterable[File]) -> dict[Key, LidarNetwork]:
    """The others. Raises EchogridError."""
    return {key: LidarNetwork(file) for key, file in numbered(files) if file.path.suffix == ".pt"}
