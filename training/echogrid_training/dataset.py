"""The samples of simulated drives as small arrays, the split by towns, and the paper's augmentation.

Cutting a drive of 40 s takes seconds, so its samples are kept beside its folder as NAME.samples.npz, and cut anew when the drive or the
code that draws images changes.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

import echogrid
from echogrid.config import load_config
from echogrid.core.raster import GridSpec, Image
from echogrid.errors import EchogridError
from echogrid_training import ground_truth, samples
from echogrid_training.recording import Track, untracked

SURE = 127  # what a label of 1 is stored as
HELD_OUT = 8  # one town in so many is for validation
SPEC = GridSpec()  # what the network is made for

Bits = NDArray[np.uint8]
Labels = NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Images and labels of one or many drives."""

    images: Bits  # (N, 2048): np.packbits of the 128 x 128 cells in which a detection lies
    labels: Labels  # (N, 128, 128): 127 times the soft label, of the same sign

    def __len__(self) -> int:
        return len(self.images)

    def digest(self) -> str:
        """sha256 of what would be learned from."""
        return hashlib.sha256(self.images.tobytes() + self.labels.tobytes()).hexdigest()

    def batch(self, chosen: NDArray[np.intp]) -> tuple[NDArray[np.int8], Labels]:
        """Images (n, 128, 128), -1 or 1, and labels (n, 128, 128) in [-127, 127], of the chosen ones."""
        bits = np.unpackbits(self.images[chosen], axis=1).reshape(-1, SPEC.cells, SPEC.cells)
        return 2 * bits.astype(np.int8) - 1, self.labels[chosen]


def joined(parts: Iterable[Samples]) -> Samples:
    """All of them in one, in their order."""
    held = [*parts, Samples(np.zeros((0, SPEC.cells**2 // 8), np.uint8), np.zeros((0, SPEC.cells, SPEC.cells), np.int8))]
    return Samples(np.concatenate([part.images for part in held]), np.concatenate([part.labels for part in held]))


def packed(pairs: Iterable[tuple[Image, Image]]) -> Samples:
    """Of images (1, 128, 128) in [-1, 1] and true log-odds (128, 128)."""
    images, labels = [], []
    for image, log_odds in pairs:
        images.append(np.packbits(image.reshape(-1) > 0))
        size = np.abs(SURE * ground_truth.soft(log_odds)).round().clip(1)  # evidence that nearly cancels is none the less observed
        labels.append(ground_truth.ternary(log_odds) * size.astype(np.int8))
    if not images:
        return joined(())
    return Samples(np.stack(images), np.stack(labels))


def ternary(labels: Labels) -> Image:
    """-1, 0 or 1 of stored labels: the paper's three classes."""
    return np.sign(labels).astype(np.float32)


def soft(labels: Labels) -> Image:
    """Stored labels as they were: in [-1, 1], within 1 / 254."""
    return labels.astype(np.float32) / np.float32(SURE)


def find_drives(folder: Path) -> list[Path]:
    """The simulated drives in a folder, however deep, by path. Raises EchogridError where there are none."""
    if not folder.is_dir():
        raise EchogridError(f"{folder}: there is no such folder of simulated drives")
    found = sorted(path.parent for path in folder.rglob("truth.npz") if not any(part.startswith(".") for part in path.parts))
    if not found:
        raise EchogridError(f"{folder}: holds no simulated drives; make some with: echogrid-train simulate --out {folder} …")
    return found


def load_drive(drive: Path) -> Samples:
    """The drive's samples, from beside it if they are still true, else cut and kept there. Raises EchogridError."""
    kept, source = drive.with_name(f"{drive.name}.samples.npz"), _source(drive)
    held = _read(kept, source)
    if held is not None:
        return held
    spec = load_config(drive / "echogrid.toml").grid.spec()
    if spec != SPEC:
        raise EchogridError(
            f"{drive / 'echogrid.toml'}: grid of {spec.cells} cells of {spec.cell} m found, "
            f"expected {SPEC.cells} of {SPEC.cell}: the network is made for that"
        )
    cut = packed((sample.image, sample.truth) for sample in samples.samples(drive))
    partial = kept.with_name(f".{kept.name}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, images=cut.images, labels=cut.labels, source=np.array(source))
        partial.replace(kept)
    except OSError as error:
        raise EchogridError(f"{kept}: cannot be written: {error.strerror}") from error
    return cut


def load_drives(drives: Iterable[Path], track: Track = untracked) -> list[Samples]:
    """Of each drive, in order. Raises EchogridError."""
    return [load_drive(drive) for drive in track(list(drives), "cutting samples")]


def _source(drive: Path) -> str:
    """sha256 of all that a drive's samples come from: its files, and the code from the frames to the image."""
    service = Path(echogrid.__file__).parent
    code = [Path(samples.__file__), Path(ground_truth.__file__), Path(__file__), service / "pipeline.py"]
    code += sorted((service / "core").glob("*.py")) + sorted((service / "io").glob("*.py"))
    total = hashlib.sha256()
    for path in [*sorted(path for path in drive.iterdir() if path.is_file()), *code]:
        total.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _read(path: Path, source: str) -> Samples | None:
    """None where there is nothing, or something of another source, or torn."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as held:
            return Samples(held["images"], held["labels"]) if str(held["source"]) == source else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def split(drives: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Drives to learn from, and drives to validate on: by town, since patches half a metre apart show the same.

    Which side a town falls on hangs on its name alone, so that more towns do not move the others; with two towns or more, no side is empty.
    """
    towns: dict[str, list[Path]] = {}
    for drive in drives:
        towns.setdefault(town(drive), []).append(drive)
    ranked = sorted(towns, key=lambda name: hashlib.sha256(name.encode()).digest())
    held_out = [name for name in ranked if hashlib.sha256(name.encode()).digest()[0] < 256 // HELD_OUT] or ranked[: len(ranked) > 1]
    if len(held_out) == len(ranked):
        held_out = held_out[:-1]
    learned = [drive for name, members in towns.items() if name not in held_out for drive in members]
    return sorted(learned), sorted(drive for name in held_out for drive in towns[name])


class Place(msgspec.Struct):
    """What of a campaign's plan says which town a drive is of."""

    seed: int | None = None
    osm: str | None = None


def town(drive: Path) -> str:
    """A name for the town. Generated towns are one a drive; all drives through an OpenStreetMap extract may share its streets."""
    try:
        place = msgspec.json.decode((drive.parent / "campaign.json").read_bytes(), type=Place)
    except (OSError, msgspec.DecodeError):
        place = Place()
    return drive.name if place.osm is None else Path(place.osm).name


def augment(images: NDArray[np.int8], labels: Labels, rng: np.random.Generator) -> tuple[NDArray[np.int8], Labels]:
    """The paper's: each pair of (n, 128, 128) turned by a random multiple of 90°, then flipped at random along both axes.

    Only left for right is a true symmetry of a car with radars at its corners; the others are other mountings.
    """
    both = np.stack((images, labels), axis=1)  # (n, 2, H, W)
    turns, flips = rng.integers(4, size=len(both)), rng.integers(2, size=(len(both), 2))
    for index, (turn, (rows, columns)) in enumerate(zip(turns, flips, strict=True)):
        turned = np.rot90(both[index], turn, axes=(1, 2))
        both[index] = turned[:, :: 1 - 2 * rows, :: 1 - 2 * columns].copy()
    return both[:, 0], both[:, 1]
