"""Drives to plant mistakes into, and what a check says of them."""

from __future__ import annotations

import math
import tempfile
from functools import cache
from pathlib import Path

import can
import numpy as np

from echogrid.can.intake.frames import FrameBatch
from echogrid.config.loading import load_config
from echogrid.judging.finding import Finding
from echogrid.judging.listening import Listener
from echogrid.judging.mending import Fix
from echogrid.logs.log import Log
from tests.judging.mistakes import Mistake, Planted
from tests.support import world
from tests.support.places import DEMO

Said = list[tuple[Finding, Fix]]


@cache
def shipped(first: float = 0.0, seconds: float = 1e9) -> Planted:
    """A stretch of the shipped drive."""
    return drive(DEMO, first, seconds)


def drive(folder: Path, first: float = 0.0, seconds: float = 1e9) -> Planted:
    messages: list[can.Message] = []
    began = None
    for message in Log(folder / "can.log.gz"):
        began = message.timestamp if began is None else began
        if message.timestamp - began >= first + seconds:
            break
        if message.timestamp - began >= first:
            messages.append(message)
    return Planted((folder / "echogrid.toml").read_text(), messages)


@cache
def winding(seconds: float = 24.0) -> Planted:
    """A car of points and finite differences: it stands, then winds between two rows of posts, faster and slower."""
    step = 1e-3
    time = np.arange(-1.0, seconds + 1.0, step)
    going = np.clip((time - 5.0) / 2.0, 0.0, 1.0)
    speed = going * (6.0 + 2.5 * np.sin(0.9 * time))
    rate = going * 0.25 * np.sin(0.55 * time)
    yaw = np.cumsum(rate) * step
    x, y = np.cumsum(speed * np.cos(yaw)) * step, np.cumsum(speed * np.sin(yaw)) * step

    def path(at: float) -> tuple[float, float, float]:
        return tuple(float(np.interp(at, time, values)) for values in (x, y, yaw))  # type: ignore[return-value]

    random = np.random.default_rng(5)
    along = np.interp(np.arange(-20.0, 160.0, 0.8), np.cumsum(speed) * step, np.arange(len(time)))
    posts = []
    for n in along.astype(int):
        for side in (-1, 1):
            away = side * random.uniform(4.0, 14.0)
            posts.append((x[n] - away * math.sin(yaw[n]) + random.normal(), y[n] + away * math.cos(yaw[n]) + random.normal()))
    posts += [(float(a), float(b)) for a, b in random.uniform(-25, 25, (60, 2))]
    return Planted(world.CONFIG, world.record(path, [world.standing(posts)], seconds))


def check(planted: Planted) -> Said:
    """All findings with their fixes."""
    with tempfile.TemporaryDirectory() as folder:
        source = planted.write(Path(folder))
        listener = Listener(load_config(source), source)
        listener.take(FrameBatch.of(planted.messages))
        _, findings, mender = listener.judged()
        return [(finding, mender.fix(finding)) for finding in findings]


def found(mistake: Mistake, said: Said) -> bool:
    """Whether the code was said of the radars that are meant, in one finding or in several."""
    named = {name for finding, _ in said if finding.code == mistake.code for name in finding.radars}
    return any(finding.code == mistake.code for finding, _ in said) and (not mistake.radars or named == set(mistake.radars))


def mended(mistake: Mistake, sound: Planted, said: Said) -> bool:
    """Whether the lines said are the ones that were changed, with the values that they had, within the tolerance."""
    fixes = [fix for finding, fix in said if finding.code == mistake.code]
    if mistake.says:
        return bool(fixes) and all(fix.says for fix in fixes)
    config = {path: value for fix in fixes for path, value in fix.config.items()}
    for path, wanted in mistake.config.items():
        if path not in config:
            return False
        if wanted is None:
            wanted = sound.value(int(path[1]), str(path[2]))
        if isinstance(wanted, str) or mistake.within == 0:
            if config[path] != wanted:
                return False
        elif abs(math.remainder(config[path] - wanted, 360.0)) > mistake.within:
            return False
    for path, wanted in mistake.profile.items():
        owners = mistake.radars or ("motion",)
        if any(all(fix.profiles.get(owner, {}).get(path) != wanted for fix in fixes) for owner in owners):
            return False
    return True


def others(mistake: Mistake, said: Said) -> list[str]:
    """Codes that were said besides."""
    return sorted({finding.code for finding, _ in said} - {mistake.code})
