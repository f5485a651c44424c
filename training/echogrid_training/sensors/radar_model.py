"""A corner radar: from what stands and drives around it to the list of detections it reports.

Every scatterer in sight has a signal-to-noise ratio by the radar equation. Its power in one scan is exponentially distributed
(Swerling I), so that it passes the threshold with probability P_fa^(1 / (1 + SNR)). Of what passes, one detection per resolution cell in
range, range rate and azimuth is left, and it is measured with errors. Under way the range rate tells directions apart, at standstill it
does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.static_gate import fold
from echogrid_training.sensors.episode import NEAR, Corner, Episode, RadarType
from echogrid_training.sensors.ghosts import FAINTER, ghosts
from echogrid_training.sensors.scatterers import WAVES, Scatterers, moving_scatterers, placed, static_scatterers
from echogrid_training.sensors.surfaces import LOSS as LOSSES
from echogrid_training.sensors.surfaces import Flats, barriers, flats
from echogrid_training.sensors.visibility import Indices, Near, Presence, losses
from echogrid_training.towns.town import Town

FAINT = -3.0  # dB of signal to noise, below which a detection is too rare (0.2 %) to be drawn
FADES = 8.0  # dB that a scatterer may be stronger for a while
NOMINAL = 33.0  # dB: signal to noise of 0 dBsm at 10 m, which gives a detection probability of a half at 35 m
BEST_AZIMUTH = (np.radians((0.0, 45.0, 60.0, 75.0)), np.radians((0.3, 1.0, 3.0, 5.0)))  # rad off boresight, rad of error
ELEVATION = np.radians(6.0)  # off the horizontal, where one way of the antenna pattern has lost 3 dB
TURNED_DOWN = 6.0  # m: for what is nearer, receivers turn down their gain
CLUTTER_REACH = 1.2 * NEAR

GHOST_SOURCES = 12.0  # how many more reflections are mirrored than are seen to be: most mirrors are too small
TWICE_FROM, TWICE_LOSS = 35.0, 22.0  # dB: reflections so strong that they come back again
BEAM_AT_MOST = np.radians(12.7)  # rad: a single beam is compared with another one, which is as good as eight antennas

# Wave numbers (rad/m) and phases of how well things reflect, wherever they stand.
PATCHES = np.random.default_rng(0).normal(size=(8, 3)) * (1.0 / 2.5, 1.0 / 2.5, np.pi)

ECHO = np.dtype([(name, float) for name in ("range", "azimuth", "range_rate", "snr", "path", "spread", "flutter", "deeper", "aside")])
Echoes = NDArray[np.void]  # (N,) of ECHO: m, rad, m/s, dB, dB (SNR less cross-section), m, m/s; m and rad to the middle of its body


@dataclass(frozen=True, slots=True)
class Sensor:
    """Where a radar is and how it moves over ground."""

    x: float  # m
    y: float
    yaw: float  # rad
    vx: float  # m/s
    vy: float

    @property
    def place(self) -> Floats:
        """(2,) m."""
        return np.array((self.x, self.y))


def sensor_at(world_from_base: SE2, base_from_sensor: SE2, speed: float, yaw_rate: float) -> Sensor:
    """The radar of a car that moves with speed (m/s) and yaw rate (rad/s)."""
    pose = world_from_base @ base_from_sensor
    arm_x, arm_y = pose.x - world_from_base.x, pose.y - world_from_base.y
    cos, sin = float(np.cos(world_from_base.yaw)), float(np.sin(world_from_base.yaw))
    return Sensor(pose.x, pose.y, pose.yaw, speed * cos - yaw_rate * arm_y, speed * sin + yaw_rate * arm_x)


class Surroundings:
    """A town as radars see it: its scatterers, flats and barriers, with what is near looked up by place."""

    def __init__(self, town: Town, reach: float) -> None:
        rng = np.random.default_rng((town.seed, 1))
        self.scatterers = static_scatterers(town.things, rng)
        self.flats: Flats = flats(town.things, rng)
        self.barriers, self.losses = barriers(town.things)
        self.bodies = moving_scatterers(town.movers, rng)
        self.body_losses = np.array([LOSSES[mover.material] for mover in town.movers])
        places = np.stack((self.scatterers["x"], self.scatterers["y"]), axis=-1)
        self.reach = reach
        self._standing: tuple[Indices, Scatterers] | None = None  # the last block's: looking them up costs more than all the rest
        self.near_scatterers = Near(np.repeat(places[:, None], 2, axis=1), reach)
        self.near_flats = Near(self.flats.segments, reach)
        self.near_barriers = Near(self.barriers, reach)

    def barriers_at(self, place: Floats, traffic: Presence) -> tuple[Floats, Floats]:
        """Segments (S, 2, 2) m around a place and their losses (S,) dB, traffic included."""
        near = self.near_barriers(place)
        segments = np.concatenate((self.barriers[near], traffic.segments()))
        return segments, np.concatenate((self.losses[near], np.repeat(self.body_losses[traffic.mover], 4)))

    def standing_at(self, place: Floats) -> Scatterers:
        """The scatterers around a place that are the same for every sensor. They are not to be written to."""
        near = self.near_scatterers(place)
        if self._standing is None or self._standing[0] is not near:
            self._standing = near, self.scatterers[near]
        return self._standing[1]

    def changing_at(self, place: Floats, traffic: Presence, rng: np.random.Generator) -> Scatterers:
        """Those of the traffic, and the flats' foot points as seen from a place."""
        rows = [self._shine(place, rng)]
        for mover, *state in zip(traffic.mover, traffic.x, traffic.y, traffic.yaw, traffic.speed, traffic.yaw_rate, strict=True):
            if np.hypot(state[0] - place[0], state[1] - place[1]) < self.reach:
                rows.append(placed(self.bodies[mover], *state))
        return np.concatenate(rows)

    def _shine(self, place: Floats, rng: np.random.Generator) -> Scatterers:
        """Each flat's foot point, and a weaker reflection beside it, where the surface is uneven."""
        near = self.near_flats(place)
        start, end = self.flats.segments[near, 0], self.flats.segments[near, 1]
        along = end - start
        length = np.hypot(along[:, 0], along[:, 1])
        share = ((place - start) * along).sum(axis=1) / length**2
        beside = np.clip(share + rng.normal(0.0, 0.5, len(near)) / length, 0.0, 1.0)
        share = np.clip(share, 0.0, 1.0)
        rows = np.concatenate((self.flats.shine[near], self.flats.shine[near]))
        foot = np.concatenate((start + share[:, None] * along, start + beside[:, None] * along))
        rows["x"], rows["y"] = foot[:, 0], foot[:, 1]
        back = np.cos(rows["facing"]) * (place[0] - foot[:, 0]) + np.sin(rows["facing"]) * (place[1] - foot[:, 1]) < 0
        rows["facing"] += np.where(back, np.pi, 0.0)  # both sides shine; that of a building's inside is out of sight
        rows["rcs"][len(near) :] -= 6.0
        rows["phase"][len(near) :] += 1.0
        return rows


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What sets the density: the signal-to-noise ratio of 0 dBsm at 10 m on boresight (dB), and the share of detections that are kept."""

    power: float = NOMINAL
    kept: float = 1.0


def path_gain(range_: Floats, azimuth: Floats, radar: RadarType, power: float) -> Floats:
    """(N,) dB: the signal-to-noise ratio that 0 dBsm would have."""
    pattern = 3.0 * (np.abs(azimuth) / radar.beam) ** 1.5  # one way
    gain: Floats = power - 2.0 * pattern - 40.0 * np.log10(np.hypot(range_, TURNED_DOWN) / 10.0)
    return gain


def echoes(rows: Scatterers, sensor: Sensor, radar: RadarType, power: float) -> tuple[Echoes, Scatterers]:
    """What reaches the radar if nothing is in between, and the scatterers it comes from, those left out that are far too weak."""
    dx, dy = rows["x"] - sensor.x, rows["y"] - sensor.y
    distance = np.hypot(dx, dy)
    azimuth = np.arctan2(dy, dx) - sensor.yaw
    azimuth -= 2 * np.pi * np.round(azimuth / (2 * np.pi))
    seen = np.flatnonzero((distance < radar.max_range) & (distance > 0.3) & (np.abs(azimuth) < radar.half_fov))
    path = path_gain(distance[seen], azimuth[seen], radar, power)
    strong = rows["rcs"][seen] + path > FAINT - FADES
    seen, path = seen[strong], path[strong]
    rows = rows[seen]
    dx, dy, distance, azimuth = (values[seen] for values in (dx, dy, distance, azimuth))

    aspect = np.arctan2(-dy, -dx) - rows["facing"]
    aspect -= 2 * np.pi * np.round(aspect / (2 * np.pi))
    fading = np.sin(rows["phase"] - rows["wave_x"] * dx[:, None] - rows["wave_y"] * dy[:, None]).sum(axis=1)
    rcs = rows["rcs"] + radar.fading * np.sqrt(2.0 / WAVES) * fading
    if radar.patchy > 0.0:
        rcs += radar.patchy * patchiness(rows["x"], rows["y"])
    rcs -= 3.0 * (aspect / rows["width"]) ** 2 + 6.0 * (np.arctan2(rows["height"], distance) / ELEVATION) ** 2
    out = np.empty(len(rows), dtype=ECHO)
    out["range"] = distance + rows["beyond"]
    out["azimuth"] = azimuth
    out["range_rate"] = ((rows["vx"] - sensor.vx) * dx + (rows["vy"] - sensor.vy) * dy) / distance
    out["snr"], out["path"] = rcs + path, path
    out["spread"], out["flutter"] = rows["spread"], rows["flutter"]
    out["deeper"] = (rows["into_x"] * dx + rows["into_y"] * dy) / distance
    out["aside"] = (rows["into_y"] * dx - rows["into_x"] * dy) / distance**2
    heard = out["snr"] > FAINT
    return out[heard], rows[heard]


def patchiness(x: Floats, y: Floats) -> Floats:
    """(N,) of sigma 1 over the world: nearly the same within a car's width, and another one a few cars on."""
    phase = np.outer(x, PATCHES[:, 0]) + np.outer(y, PATCHES[:, 1]) + PATCHES[:, 2]
    field: Floats = np.sqrt(2.0 / len(PATCHES)) * np.sin(phase).sum(axis=1)
    return field


def received(
    surroundings: Surroundings, traffic: Presence, sensor: Sensor, episode: Episode, power: float, rng: np.random.Generator
) -> Echoes:
    """All that reaches the radar strongly enough to be detected now and then."""
    place, radar = sensor.place, episode.radar
    hiding = surroundings.barriers_at(place, traffic)
    pieces = [
        echoes(rows, sensor, radar, power) for rows in (surroundings.standing_at(place), surroundings.changing_at(place, traffic, rng))
    ]
    direct, rows = (np.concatenate(column) for column in zip(*pieces, strict=True))
    direct["snr"] -= losses(*hiding, place, np.stack((rows["x"], rows["y"]), axis=-1))
    strong = direct["snr"] > FAINT
    direct, rows = direct[strong], rows[strong]
    loud = direct["snr"] > FAINT + FAINTER[0]
    images = ghosts(rows[loud], GHOST_SOURCES * episode.ghosts, surroundings.flats, surroundings.near_flats(place), hiding, place)
    mirrored, _ = echoes(images, sensor, radar, power)
    twice = direct[(rows["luck"] < GHOST_SOURCES * episode.ghosts) & (direct["snr"] > TWICE_FROM)].copy()
    for name, change in (("range", 2.0), ("range_rate", 2.0)):  # car, wall, car, wall, car
        twice[name] *= change
    twice["snr"] -= TWICE_LOSS
    return np.concatenate((direct, mirrored, twice[twice["range"] < radar.max_range]))


def detect(arriving: Echoes, radar: RadarType, rng: np.random.Generator) -> Echoes:
    """Those that pass the threshold in this scan, one per resolution cell; `snr` is now that of the power received."""
    power = (1.0 + 10.0 ** (arriving["snr"] / 10.0)) * rng.standard_exponential(len(arriving))
    passed = power > -np.log(radar.false_alarm)
    found = arriving[passed]
    found["snr"] = 10.0 * np.log10(power[passed])
    return merge(found, radar, rng.uniform(size=3))


def merge(found: Echoes, radar: RadarType, offset: Floats) -> Echoes:
    """The strongest of each resolution cell, or its like at the centroid of all their power. `offset` (3,): where the cells begin, as
    shares of a cell.
    """
    # An antenna's beams are equally wide in the sine of the azimuth.
    cells = (found["range"] / radar.range_resolution, found["range_rate"] / radar.range_rate_resolution) + (
        (np.sin(found["azimuth"]) / np.sin(min(radar.azimuth_resolution, np.pi / 2)),) if radar.azimuth_resolution < np.pi else ()
    )
    key = np.zeros(len(found), dtype=np.int64)
    for cell, start in zip(cells, offset, strict=False):
        key = key * 20011 + np.floor(cell + start).astype(np.int64)
    order = np.argsort(-found["snr"], kind="stable")
    _, first, member = np.unique(key[order], return_index=True, return_inverse=True)
    kept = found[order[first]]
    if radar.centroids:
        share = 10.0 ** (found["snr"][order] / 10.0)
        total = np.bincount(member, share)
        for name in ("range", "azimuth"):
            kept[name] = np.bincount(member, share * found[name][order]) / total
    return kept


def measure(found: Echoes, corner: Corner, radar: RadarType, rng: np.random.Generator) -> Echoes:
    """The detections as the radar reports them: `range`, `azimuth` and `range_rate` with their errors."""
    count, snr = len(found), 10.0 ** (found["snr"] / 10.0)
    out = found.copy()
    out["range"] += rng.normal(size=count) * (radar.range_sigma * np.sqrt(np.maximum(1.0, 20.0 / snr)) + found["spread"])

    off = np.abs(found["azimuth"])
    by_noise = min(radar.azimuth_resolution, BEAM_AT_MOST) / (1.6 * np.cos(np.minimum(off, 1.4)) * np.sqrt(2.0 * snr))
    sigma = radar.azimuth_sigma * np.maximum(np.interp(off, *BEST_AZIMUTH), by_noise)
    sigma = np.where(rng.uniform(size=count) < radar.tails, 3.0, 1.0) * np.minimum(sigma, np.radians(6.0))
    azimuth = found["azimuth"] + corner.azimuth_bias + corner.ripple * np.sin(5.0 * found["azimuth"]) + rng.normal(size=count) * sigma
    jump = np.radians(rng.uniform(10.0, 40.0, count)) * np.where(azimuth > 0, -1.0, 1.0)  # inwards, where the other lobe is in view
    azimuth = np.where(rng.uniform(size=count) < radar.azimuth_outliers, azimuth + jump, azimuth)

    rate = found["range_rate"] + corner.range_rate_bias + rng.normal(size=count) * np.hypot(radar.range_rate_sigma, found["flutter"])
    most = radar.ambiguity / 2 or 15.0
    out["range_rate"] = np.where(rng.uniform(size=count) < radar.doppler_outliers, rng.uniform(-most, most, count), rate)

    inward, detour = displaced(count, radar, rng)
    out["range"] += corner.range_bias + inward * found["deeper"] + detour
    out["azimuth"] = np.clip(azimuth + inward * found["aside"], -radar.half_fov, radar.half_fov)
    return out


def displaced(count: int, radar: RadarType, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """(count,) share of the way to its body's middle by which each detection lies inside, and (count,) m that it lies farther away."""
    if radar.inward == radar.detour == 0.0:
        return np.zeros(count), np.zeros(count)
    return radar.inward * rng.uniform(size=count), radar.detour * rng.standard_exponential(count)


def clutter(sensor: Sensor, episode: Episode, power: float, rng: np.random.Generator) -> Echoes:
    """Detections of nothing, half of which move, the more of them the farther away, and of the ground near the car."""
    radar = episode.radar
    nothing = rng.poisson(episode.clutter * episode.density * (CLUTTER_REACH / NEAR) ** 3)
    ground = rng.poisson(episode.ground * episode.density)
    out = np.zeros(nothing + ground, dtype=ECHO)
    out["range"][:nothing] = np.maximum(CLUTTER_REACH * np.cbrt(rng.uniform(size=nothing)), 1.0)
    out["range"][nothing:] = rng.uniform(1.5, 8.0, ground)
    out["azimuth"] = rng.uniform(-radar.half_fov, radar.half_fov, len(out))
    bearing = out["azimuth"] + sensor.yaw
    standing = -(sensor.vx * np.cos(bearing) + sensor.vy * np.sin(bearing))
    moves = (rng.uniform(size=len(out)) < 0.5) & (np.arange(len(out)) < nothing)
    out["range_rate"] = np.where(moves, rng.uniform(-15.0, 15.0, len(out)), standing)
    out["path"] = path_gain(out["range"], out["azimuth"], radar, power)
    out["snr"] = 10.0 * np.log10(-np.log(radar.false_alarm)) + 2.0 * rng.standard_exponential(len(out))
    return out


def sense(
    surroundings: Surroundings,
    traffic: Presence,
    sensor: Sensor,
    corner: Corner,
    episode: Episode,
    sensitivity: Sensitivity,
    rng: np.random.Generator,
    stamp_ns: int = 0,
) -> RadarScan:
    """One scan of one radar."""
    radar = episode.radar
    power = sensitivity.power - 40.0 * corner.blockage
    found = detect(received(surroundings, traffic, sensor, episode, power, rng), radar, rng)
    found = np.concatenate((found, clutter(sensor, episode, power, rng)))
    reported = measure(found[rng.uniform(size=len(found)) < sensitivity.kept], corner, radar, rng)
    order = np.argsort(-reported["snr"] if radar.strongest_first else reported["range"], kind="stable")
    reported = reported[order[: radar.most]]
    range_, azimuth = rounded(np.maximum(reported["range"], 0.1), reported["azimuth"], radar.position_step)
    return RadarScan(
        corner.mount.name,
        stamp_ns,
        stamp_ns + round(radar.age * 1e9),
        range=range_,
        azimuth=azimuth,
        range_rate=fold(reported["range_rate"], radar.ambiguity),
        rcs=reported["snr"] - reported["path"] + radar.rcs_offset,
        ambiguity=radar.ambiguity,
        blockage=corner.blockage,
    )


def rounded(range_: Floats, azimuth: Floats, step: float) -> tuple[Floats, Floats]:
    """Range and azimuth of points whose x and y are multiples of `step` m; as they are where it is 0."""
    if step <= 0:
        return range_, azimuth
    x, y = np.round(range_ * np.cos(azimuth) / step) * step, np.round(range_ * np.sin(azimuth) / step) * step
    return np.hypot(x, y), np.arctan2(y, x)
