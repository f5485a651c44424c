"""Many simulated drives: one folder a town, the same whatever number of workers makes them, and to be gone on with after a kill."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from echogrid.errors import EchogridError
from echogrid_training.drive import check_free, write_drive
from echogrid_training.episode import draw_episode
from echogrid_training.layout import make_town
from echogrid_training.osm import town_from_osm
from echogrid_training.simulate import simulate

PLAN = "campaign.json"


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is simulated: `towns` drives of `seconds` each, through towns of a family or through the place of an OpenStreetMap extract."""

    family: str
    towns: int
    seconds: float
    seed: int
    osm: str | None = None

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
    _claim(campaign, out)
    missing = [index for index in range(campaign.towns) if not (out / campaign.name(index)).is_dir()]
    if workers <= 1:
        for index in missing:
            on_done(make(campaign, index, out))
        return len(missing)
    # Spawned, not forked: a fork of a process with threads may never come up.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        pending = [pool.submit(make, campaign, index, out) for index in missing]
        try:
            for done in as_completed(pending):
                on_done(done.result())
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return len(missing)


def make(campaign: Campaign, index: int, out: Path) -> str:
    """One town's drive folder, written whole or not at all; returns its name."""
    seed = campaign.town_seed(index)
    folder = out / campaign.name(index)
    check_free(folder, force=False)
    if campaign.osm is None:
        town = make_town(campaign.family, seed, campaign.seconds)
    else:
        town = town_from_osm(Path(campaign.osm), seed, campaign.seconds)
    recording, truth = simulate(town, draw_episode(seed, campaign.family))
    write_drive(recording, folder, seed=seed, truth_map=truth)
    return folder.name


def _claim(campaign: Campaign, out: Path) -> None:
    """Notes the campaign in the folder, or compares it with the one that is noted there: only `towns` may differ."""
    plan = out / PLAN
    try:
        out.mkdir(parents=True, exist_ok=True)
        if plan.exists():
            noted = msgspec.json.decode(plan.read_bytes(), type=Campaign)
            for key in ("family", "seconds", "seed", "osm"):
                if getattr(noted, key) != getattr(campaign, key):
                    raise EchogridError(
                        f"{plan}: the folder holds a campaign with {key} {getattr(noted, key)}, expected {getattr(campaign, key)}: "
                        "give another folder"
                    )
        plan.write_bytes(msgspec.json.encode(asdict(campaign)))
    except OSError as error:
        raise EchogridError(f"{out}: cannot be written: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise EchogridError(f"{plan}: does not note a campaign: {error}") from error
