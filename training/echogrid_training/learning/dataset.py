"""The samples of simulated drives as arrays, the split by towns, and the augmentations.

Cutting a drive of 40 s takes seconds, so its samples are kept beside its folder as NAME.samples.npz, and cut again when the drive or the
code that draws images changes.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

import echogrid
import echogrid_training
from echogrid.config.loading import load_config
from echogrid.core.evidence.history_raster import CHANNELS, Bytes
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.errors import EchogridError
from echogrid_training.drives import samples
from echogrid_training.drives.samples import Sample
from echogrid_training.recording import Track, untracked
from echogrid_training.sensors.disturbance import Disturbance
from echogrid_training.sources import load_npz
from echogrid_training.tasks import processes
from echogrid_training.truth import ground_truth

SURE = 127  # what a label of 1 is stored as
UNJUDGED = -128  # the label of a cell of which nothing is to be learned
HELD_OUT = 8  # one town in so many is for validation
ARRAYS = ("images", "lidar", "labels")  # of Samples
SPEC = GridSpec()  # what the networks are made for

CUT_BY = ("drives/samples.py", "sensors/disturbance.py", "truth/ground_truth.py", "truth/earned.py")  # what scans become samples by
READ_BY = ("core", "can", "logs")  # rooms of the service by which frames become scans and images

Labels = NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Images and labels of one or many drives."""

    images: Bytes  # (N, 12, 128, 128), as echogrid.core.evidence.history_raster draws them
    lidar: Bytes  # (N, 2048): np.packbits of the cells with a return of the lidar
    labels: Labels  # (N, 128, 128): 127 times the soft label, of the same sign

    def __len__(self) -> int:
        return len(self.images)

    def digest(self) -> str:
        """sha256 of what would be learned from."""
        total = hashlib.sha256()
        for array in (self.images, self.lidar, self.labels):
            total.update(array.data)
        return total.hexdigest()

    def chosen(self, which: NDArray[np.intp]) -> Samples:
        return Samples(self.images[which], self.lidar[which], self.labels[which])

    @staticmethod
    def empty(count: int) -> Samples:
        """Room for so many."""
        side = SPEC.cells
        return Samples(
            np.zeros((count, len(CHANNELS), side, side), np.uint8),
            np.zeros((count, side * side // 8), np.uint8),
            np.zeros((count, side, side), np.int8),
        )


def read_samples(path: Path) -> Samples:
    """A file of samples that somebody else made (docs/simulator.md). Raises EchogridError."""
    arrays = load_npz(path, ARRAYS)
    count = len(arrays["labels"]) if arrays["labels"].ndim else 0
    for name in ARRAYS:
        found, expected = arrays[name], getattr(Samples.empty(0), name)
        if found.dtype != expected.dtype or found.shape != (count, *expected.shape[1:]):
            shape = ", ".join(map(str, ("N", *expected.shape[1:])))
            raise EchogridError(f"{path}: '{name}' is {found.dtype} of shape {found.shape}, expected {expected.dtype} of ({shape})")
    return Samples(*(arrays[name] for name in ARRAYS))


def joined(parts: Sequence[Samples]) -> Samples:
    """All of them in one, in their order."""
    whole, start = Samples.empty(sum(len(part) for part in parts)), 0
    for part in parts:
        for name in ARRAYS:
            getattr(whole, name)[start : start + len(part)] = getattr(part, name)
        start += len(part)
    return whole


def packed(cut: Iterable[Sample]) -> Samples:
    """Of the samples of a drive."""
    images, lidar, labels = [], [], []
    for sample in cut:
        images.append(sample.image)
        lidar.append(np.packbits(sample.lidar.reshape(-1)))
        size = np.abs(SURE * ground_truth.soft(sample.truth)).round().clip(1)  # evidence that nearly cancels is none the less observed
        labels.append(ground_truth.ternary(sample.truth) * size.astype(np.int8))
    return Samples(np.stack(images), np.stack(lidar), np.stack(labels)) if images else Samples.empty(0)


def of_lidar(lidar: Bytes) -> NDArray[np.float32]:
    """(n, 1, 128, 128): 1 where the lidar has a return, else -1, of packed bits (n, 2048)."""
    bits = np.unpackbits(lidar, axis=1).reshape(-1, 1, SPEC.cells, SPEC.cells)
    return np.where(bits > 0, np.float32(1), np.float32(-1))


def of_detections(images: Bytes) -> NDArray[np.float32]:
    """(n, 1, 128, 128): the paper's image, 1 where a detection of the newest scans lies, else -1, of images (n, 12, 128, 128)."""
    return np.where(images[:, :1] > 0, np.float32(1), np.float32(-1))


def ternary(labels: Labels) -> Image:
    """-1, 0 or 1 of stored labels: the paper's three classes; 0 too of what is UNJUDGED."""
    return np.where(labels == UNJUDGED, np.float32(0), np.sign(labels).astype(np.float32))


def soft(labels: Labels) -> Image:
    """Stored labels as they were: in [-1, 1], within 1 / 254."""
    return labels.astype(np.float32) / np.float32(SURE)


def find_drives(folder: Path) -> list[Path]:
    """The simulated drives in a folder, however deep, by path. Raises EchogridError where there are none."""
    if not folder.is_dir():
        raise EchogridError(f"{folder}: there is no such folder of simulated drives")
    truths = folder.rglob("truth.npz")
    found = sorted(path.parent for path in truths if not any(part.startswith(".") for part in path.relative_to(folder).parts))
    if not found:
        raise EchogridError(f"{folder}: holds no simulated drives; make some with: echogrid-train simulate --out {folder} …")
    return found


def load_drive(drive: Path, disturbed: bool = False, whole: bool = False) -> Samples:
    """The drive's samples, from beside it if they are still true, else cut and kept there. Raises EchogridError.

    `disturbed`: with thinned scans and silent radars in some spells. `whole`: with the paper's labels, of what no radar can tell too.
    """
    kind = ("disturbed" if disturbed else "samples") + (".whole" if whole else "")
    named = drive if drive.name.strip(".") else drive.resolve()  # "." and ".." have names too
    kept, source = named.with_name(f"{named.name}.{kind}.npz"), _source(drive)
    held = _read(kept, source)
    if held is not None:
        return held
    spec = load_config(drive / "echogrid.toml").grid.spec()
    if spec != SPEC:
        raise EchogridError(
            f"{drive / 'echogrid.toml'}: grid of {spec.cells} cells of {spec.cell} m found, "
            f"expected {SPEC.cells} of {SPEC.cell}: the network is made for that"
        )
    what = Disturbance(zlib.crc32(named.name.encode())) if disturbed else None
    cut = packed(samples.samples(drive, what, whole=whole))
    partial = kept.with_name(f".{kept.name}.{os.getpid()}.partial")  # under torchrun several processes may cut the same drive
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **{name: getattr(cut, name) for name in ARRAYS}, source=np.array(source))
        partial.replace(kept)
    except OSError as error:
        raise EchogridError(f"{kept}: cannot be written: {error.strerror}") from error
    return cut


def load_drives(
    drives: Sequence[Path], track: Track = untracked, *, disturbed: bool = False, whole: bool = False, workers: int = 1
) -> Samples:
    """Of all drives, in order; what is not kept beside them is cut by `workers` processes. Raises EchogridError."""
    if workers > 1:
        with processes(workers) as pool:
            pending = [pool.submit(_cut, drive, disturbed, whole) for drive in drives]
            for done in track(pending, "cutting samples"):
                done.result()
    return joined([load_drive(drive, disturbed, whole) for drive in track(drives, "loading samples")])


def _cut(drive: Path, disturbed: bool, whole: bool) -> None:
    load_drive(drive, disturbed, whole)


def _source(drive: Path) -> str:
    """sha256 of all that a drive's samples come from: its files, and the code from the frames to the image."""
    service, training = Path(echogrid.__file__).parent, Path(echogrid_training.__file__).parent
    code = [Path(__file__), *(training / name for name in CUT_BY), service / "pipeline.py"]
    code += [path for room in READ_BY for path in sorted((service / room).rglob("*.py"))]
    total = hashlib.sha256()
    for path in [*sorted(path for path in drive.iterdir() if path.is_file()), *code]:
        total.update(path.name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _read(path: Path, source: str) -> Samples | None:
    """None where there is nothing, or something of another source, or torn."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as held:
            return Samples(*(held[name] for name in ARRAYS)) if str(held["source"]) == source else None
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


def turned(images: NDArray[np.float32], labels: Labels, rng: np.random.Generator) -> tuple[NDArray[np.float32], Labels]:
    """The paper's augmentation: each pair of (n, 1, 128, 128) and (n, 128, 128) turned by a random multiple of 90°, then flipped at random
    along both axes.

    Only left for right is a true symmetry of a car with radars at its corners; the others are other mountings.
    """
    images, labels = images.copy(), labels.copy()
    turns, flips = rng.integers(4, size=len(images)), rng.integers(2, size=(len(images), 2))
    for image, label, turn, (rows, columns) in zip(images, labels, turns, flips, strict=True):
        image[:] = np.rot90(image, turn, axes=(1, 2))[:, :: 1 - 2 * rows, :: 1 - 2 * columns].copy()
        label[:] = np.rot90(label, turn)[:: 1 - 2 * rows, :: 1 - 2 * columns].copy()
    return images, labels


def mirrored(images: Bytes, labels: Labels, rng: np.random.Generator) -> tuple[Bytes, Labels]:
    """Left for right in half of the pairs (n, C, 128, 128) and (n, 128, 128): exact for every plane of every car."""
    flip = rng.integers(2, size=len(images)).astype(bool)
    return (
        np.where(flip[:, None, None, None], images[:, :, ::-1], images),
        np.where(flip[:, None, None], labels[:, ::-1], labels),
    )
