"""Many simulated drives: one folder a town, the same with any number of workers, and resumable after a kill."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid_training.drives.drive import check_free, write_drive
from echogrid_training.drives.lidar_writer import write_lidar
from echogrid_training.drives.simulate import simulate
from echogrid_training.sensors.episode import Episode, draw_episode, paper_sensors, sparse_sensors
from echogrid_training.sensors.likeness import Likeness, as_loud, episode_like
from echogrid_training.tasks import processes
from echogrid_training.worlds.layout import make_town
from echogrid_training.worlds.osm import town_from_osm

PLAN = "campaign.json"

Kind = Literal["drawn", "paper", "sparse"]
SENSORS: dict[Kind, Callable[[int, str], Episode]] = {  # of each drive, anew
    "drawn": draw_episode,
    "paper": paper_sensors,
    "sparse": sparse_sensors,
}


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is simulated: `towns` drives of `seconds` each, through towns of a family or through the place of an OpenStreetMap extract."""

    family: str
    towns: int
    seconds: float
    seed: int
    osm: str | None = None
    sensors: Kind = "drawn"
    lidar: bool = False  # written beside each drive
    like: tuple[Likeness, ...] = ()  # cars whose radars they have by turns, in place of `sensors`

    def name(self, index: int) -> str:
        """The folder of one town."""
        return f"{self.family}-{index:05d}"

    def town_seed(self, index: int) -> int:
        """A seed of its own for each town, whatever else the campaign holds."""
        return int(np.random.SeedSequence((self.seed, index)).generate_state(1)[0])


def run(campaign: Campaign, out: Path, workers: int, on_done: Callable[[str], None]) -> int:
    """Simulates what is not there yet; returns how many drives were made. `on_done` hears the name of each.

    Raises EchogridError where the folder holds another campaign, or a drive cannot be written: what was finished stays usable.
    """
    check_folder(out)
    _compare(campaign, out)
    missing = [index for index in range(campaign.towns) if not (out / campaign.name(index)).is_dir()]
    if workers <= 1:
        names = (make(campaign, index, out) for index in missing)
        return _count(names, on_done)
    with processes(workers) as pool:
        pending = [pool.submit(make, campaign, index, out) for index in missing]
        return _count((done.result() for done in as_completed(pending)), on_done)


def _count(names: Iterable[str], on_done: Callable[[str], None]) -> int:
    count = 0
    for name in names:
        count += 1
        on_done(name)
    return count


def _note(campaign: Campaign, out: Path) -> None:
    """Says in the folder what its drives are; by each process, before a drive of its appears, so that none is ever without."""
    draft = out / f".{PLAN}.{os.getpid()}.partial"
    try:
        out.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(msgspec.json.encode(asdict(campaign)))
        draft.replace(out / PLAN)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise EchogridError(f"{out / PLAN}: cannot be written: {error.strerror}") from error


def make(campaign: Campaign, index: int, out: Path) -> str:
    """One town's drive folder, written completely or not at all; returns its name."""
    seed = campaign.town_seed(index)
    folder = out / campaign.name(index)
    check_free(folder, force=False)
    if campaign.osm is None:
        town = make_town(campaign.family, seed, campaign.seconds)
    else:
        town = town_from_osm(Path(campaign.osm), seed, campaign.seconds)
    if campaign.like:
        car = campaign.like[index % len(campaign.like)]
        recording, truth = simulate(town, episode_like(car, seed, campaign.family))
        recording = as_loud(recording, car.rcs)
    else:
        recording, truth = simulate(town, SENSORS[campaign.sensors](seed, campaign.family))
    beside = partial(write_lidar, town) if campaign.lidar else None
    _note(campaign, out)
    write_drive(recording, folder, seed=seed, truth_map=truth, beside=beside)
    return folder.name


def _compare(campaign: Campaign, out: Path) -> None:
    """Raises EchogridError where the folder holds another campaign: only the number of towns may differ."""
    plan = out / PLAN
    try:
        noted = msgspec.json.decode(plan.read_bytes(), type=Campaign)
    except FileNotFoundError:
        return
    except OSError as error:
        raise EchogridError(f"{plan}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise EchogridError(f"{plan}: does not note a campaign: {error}") from error
    if next(out.glob(f"{noted.family}-*"), None) is None:  # it never came to a drive
        return
    if noted.like != campaign.like:
        raise EchogridError(
            f"{plan}: the folder holds a campaign with other radars (--like), expected the same drives: give another folder"
        )
    for key in ("family", "seconds", "seed", "osm", "sensors", "lidar"):
        if getattr(noted, key) != getattr(campaign, key):
            raise EchogridError(
                f"{plan}: the folder holds a campaign with {key} {getattr(noted, key)}, expected {getattr(campaign, key)}: "
                "give another folder"
            )
