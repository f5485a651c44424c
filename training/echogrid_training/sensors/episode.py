"""All that is drawn anew for every drive: the car, its radars and their errors, and those of its motion sensors.

A network that has met one sensor only calls the silence of another one free space; hence the wide ranges here.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import RadarMount

NAMES = ("front_left", "front_right", "rear_left", "rear_right")
NEAR = 21.0  # m, within which detections are counted for the density: the half diagonal of the paper's patch


@dataclass(frozen=True, slots=True)
class RadarType:
    """What the four radars of a car have in common. Errors are one sigma."""

    half_fov: float = math.radians(75.0)
    max_range: float = 60.0  # m
    cycle: float = 0.050  # s
    jitter: float = 0.002  # s, at most, of each cycle's start
    age: float = 0.030  # s, from a measurement to its first frame
    beam: float = math.radians(38.0)  # off boresight, where one way of the antenna pattern has lost 3 dB
    range_resolution: float = 0.4  # m
    range_rate_resolution: float = 0.15  # m/s
    azimuth_resolution: float = math.radians(8.0)  # at boresight
    false_alarm: float = 1e-4  # probability per cell
    range_sigma: float = 0.06  # m, at best
    detour: float = 0.0  # m, mean of what a signal goes about inside and behind what it meets: under cars, through windows, round frames
    inward: float = 0.0  # share at most of the way to a body's middle by which a cluster of its echoes lies inside
    azimuth_sigma: float = 1.0  # factor on the best azimuth error, which is 0.3° ahead, 1° at 45° and 4° at 70°
    range_rate_sigma: float = 0.10  # m/s
    tails: float = 0.05  # share of detections whose azimuth errs three times as much
    azimuth_outliers: float = 0.01  # share that are off by 10 to 40°
    doppler_outliers: float = 0.05  # share with an arbitrary range rate
    ambiguity: float = 0.0  # m/s, interval of the range rate; 0: none
    centroids: bool = False  # whether a detection lies at the centroid of its resolution cell: else where the strongest echo comes from
    position_step: float = 0.0  # m, to which x and y are rounded; 0: not
    fading: float = 4.0  # dB, slow, as the aspect changes
    patchy: float = 0.0  # dB, one sigma by which whole things reflect more or less than their kind
    rcs_offset: float = -8.0  # dB between the true and the reported cross-section
    strongest_first: bool = False  # which detections are kept when there are more than the most: else the nearest
    most: int = 64  # detections in a scan


@dataclass(frozen=True, slots=True)
class Corner:
    """One radar on the car and what is wrong with it."""

    mount: RadarMount
    phase: float = 0.0  # of its cycle, as a share of the cycle
    azimuth_bias: float = 0.0  # rad, of mounting
    range_bias: float = 0.0  # m
    ripple: float = 0.0  # rad, amplitude of the radome's error over azimuth
    range_rate_bias: float = 0.0  # m/s
    blockage: float = 0.0  # 0 clear … 1 blind
    lost: tuple[float, float] = (0.0, 0.0)  # from and until when it is silent, as shares of the drive


@dataclass(frozen=True, slots=True)
class MotionErrors:
    """Errors of wheel speeds and yaw rate."""

    period: float = 0.010  # s
    wheel_scale: float = 1.0
    wheel_uneven: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # more scale error, wheel by wheel
    slip: float = 0.0  # share of speed per m/s² of acceleration
    wheel_sigma: float = 0.01  # m/s
    wheel_step: float = 0.01  # m/s
    standstill: float = 0.0  # m/s, below which wheels report 0
    wheel_latency: float = 0.0  # s
    yaw_bias: float = 0.0  # rad/s
    yaw_sigma: float = 0.002  # rad/s
    yaw_scale: float = 1.0
    yaw_step: float = 0.0002  # rad/s
    yaw_latency: float = 0.0  # s


@dataclass(frozen=True, slots=True)
class Episode:
    """One drive's draw. `density`: mean detections of a radar's scan within NEAR; the transmit power is set so that it is met."""

    seed: int
    body: Body
    radar: RadarType
    corners: tuple[Corner, ...]
    motion: MotionErrors
    density: float
    thinning: float = 0.0  # 0: a low density is all low power; 1: all arbitrary misses
    ghosts: float = 0.05  # share of the reflections that a wall mirrors
    clutter: float = 0.01  # detections of nothing, as a share of the density
    ground: float = 0.001  # the same for the ground near the car
    dropped: float = 0.005  # share of scans that never come


def paper_like(seed: int = 0) -> Episode:
    """Four radars at ±45° and ±135°, 15 to 35 detections within NEAR, and small errors: no faults, no bias."""
    body = Body(length=4.9, width=1.9, rear_overhang=1.0)
    places = ((3.7, 0.8, 45.0), (3.7, -0.8, -45.0), (-0.9, 0.8, 135.0), (-0.9, -0.8, -135.0))
    radar = RadarType()
    mounts = [RadarMount(name, SE2(x, y, math.radians(yaw)), 2 * radar.half_fov) for name, (x, y, yaw) in zip(NAMES, places, strict=True)]
    corners = tuple(Corner(mount, phase) for mount, phase in zip(mounts, (0.0, 0.27, 0.55, 0.8), strict=True))
    return Episode(seed, body, radar, corners, MotionErrors(), density=24.0)


def paper_sensors(seed: int, family: str) -> Episode:
    """paper_like with another density for every seed, and with the motion errors, mounting errors and dropped scans of a drawn episode."""
    drawn, fixed = draw_episode(seed, family), paper_like(seed)
    rng = np.random.default_rng((seed, zlib.crc32(family.encode()), 1))
    corners = tuple(
        replace(corner, azimuth_bias=other.azimuth_bias, ripple=other.ripple, range_rate_bias=other.range_rate_bias)
        for corner, other in zip(fixed.corners, drawn.corners, strict=True)
    )
    return replace(
        fixed,
        corners=corners,
        motion=drawn.motion,
        density=float(rng.uniform(15.0, 35.0)),
        dropped=drawn.dropped,
    )


def sparse_sensors(seed: int, family: str, density: float | None = None) -> Episode:
    """A drawn episode whose radars report clusters, as series sensors of the last generation do: few of them, each one for several echoes,
    somewhere within what reflects and not on its face, from radars that are not quite where and how the configuration says.
    """
    drawn = draw_episode(seed, family, density)
    rng = np.random.default_rng((seed, zlib.crc32(family.encode()), 2))
    radar = replace(
        drawn.radar,
        cycle=float(rng.uniform(0.050, 0.100)),
        range_resolution=_log(rng, 0.4, 1.8),
        azimuth_resolution=math.radians(_log(rng, 5.0, 14.0)),
        range_sigma=float(rng.uniform(0.05, 0.35)),
        azimuth_sigma=float(rng.uniform(0.8, 2.0)),
        detour=_log(rng, 0.05, 0.6),
        inward=float(rng.uniform(0.0, 0.8)),
        centroids=True,
        position_step=0.2 if rng.uniform() < 0.5 else 0.0,
        fading=float(rng.uniform(3.0, 7.0)),
        patchy=float(rng.uniform(2.0, 12.0)),
    )
    bias = rng.uniform(-0.1, 0.4)  # m, of all radars of a kind
    corners = tuple(
        replace(corner, azimuth_bias=math.radians(rng.uniform(-2.0, 2.0)), range_bias=float(bias + rng.normal(0.0, 0.08)))
        for corner in drawn.corners
    )
    return replace(
        drawn,
        radar=radar,
        corners=corners,
        density=_log(rng, 0.7, 24.0) if density is None else density,
        clutter=_log(rng, 0.01, 0.3),
        ground=float(rng.uniform(0.0, 0.02)),
    )


def draw_episode(seed: int, family: str, density: float | None = None) -> Episode:
    """The episode of a seed in a family of towns: always the same, and another one in another family; with its density drawn, or given."""
    rng = np.random.default_rng((seed, zlib.crc32(family.encode())))
    body = _body(rng)
    density = _log(rng, 2.0, 64.0) if density is None else density
    radar = _radar(rng, density)
    return Episode(
        seed=seed,
        body=body,
        radar=radar,
        corners=_corners(rng, body, radar),
        motion=_motion(rng),
        density=density,
        thinning=float(rng.uniform()),
        ghosts=float(rng.uniform(0.01, 0.06)),
        clutter=float(rng.uniform(0.003, 0.02)),
        ground=float(rng.uniform(0.0, 0.002)),
        dropped=_log(rng, 0.001, 0.01),
    )


def _body(rng: np.random.Generator) -> Body:
    return Body(*(round(float(value), 2) for value in (rng.uniform(3.9, 5.1), rng.uniform(1.7, 1.95), rng.uniform(0.75, 1.1))))


def _radar(rng: np.random.Generator, density: float) -> RadarType:
    half_fov = math.radians(rng.uniform(50.0, 80.0))
    monopulse = rng.uniform() < 0.15 and density < 20.0  # a single beam: nothing but range and Doppler tells two reflections apart
    return RadarType(
        half_fov=half_fov,
        max_range=float(rng.uniform(40.0, 80.0)),
        cycle=float(rng.uniform(0.050, 0.075)),
        jitter=0.002,
        age=float(rng.uniform(0.020, 0.060)),
        beam=float(half_fov * rng.uniform(0.4, 0.6)),
        range_resolution=_log(rng, 0.15, 0.4) if density > 30.0 else _log(rng, 0.2, 0.75),  # many detections need fine cells
        range_rate_resolution=_log(rng, 0.08, 0.3),
        azimuth_resolution=math.pi if monopulse else math.radians(_log(rng, 3.0, 8.0 if density > 30.0 else 14.0)),
        false_alarm=1e-4,
        range_sigma=float(rng.uniform(0.03, 0.10)),
        azimuth_sigma=float(rng.uniform(0.6, 1.2)),
        range_rate_sigma=float(rng.uniform(0.05, 0.12)),
        tails=float(rng.uniform(0.02, 0.08)),
        azimuth_outliers=float(rng.uniform(0.005, 0.02)),
        doppler_outliers=float(rng.uniform(0.05, 0.15) if rng.uniform() < 0.6 else rng.uniform(0.0, 0.05)),
        ambiguity=float(rng.uniform(10.0, 60.0)) if rng.uniform() < 0.4 else 0.0,
        position_step=0.2 if rng.uniform() < 0.2 else 0.0,
        fading=float(rng.uniform(3.0, 5.0)),
        rcs_offset=float(rng.uniform(-16.0, 9.0)),  # RadarScenes' and nuScenes' sensors are 17 dB apart
        strongest_first=bool(rng.uniform() < 0.3),
    )


def _corners(rng: np.random.Generator, body: Body, radar: RadarType) -> tuple[Corner, ...]:
    front = (body.length - body.rear_overhang - rng.uniform(0.1, 0.9), body.width / 2 - rng.uniform(0.05, 0.3), rng.uniform(25.0, 95.0))
    rear = (-body.rear_overhang + rng.uniform(0.05, 0.5), body.width / 2 - rng.uniform(0.05, 0.3), rng.uniform(120.0, 178.0))
    faulty = int(rng.integers(4)) if rng.uniform() < 0.15 else None  # at most one radar that fails for a while
    blocked = int(rng.integers(4)) if rng.uniform() < 0.08 else None
    bias = rng.uniform(0.0, 0.2)  # m/s, of this car's radars at most: recorded cars have 0.04 to 0.2
    corners = []
    for index, name in enumerate(NAMES):
        x, y, yaw = front if name.startswith("front") else rear
        side = 1.0 if name.endswith("left") else -1.0
        place = SE2(float(x), float(side * y), math.radians(side * yaw))
        start = float(rng.uniform(-0.3, 0.9))
        corners.append(
            Corner(
                RadarMount(name, place, 2 * radar.half_fov),
                phase=float(rng.uniform()),
                azimuth_bias=math.radians(rng.normal(0.0, 0.5)),
                ripple=math.radians(rng.uniform(0.0, 0.8)),
                range_rate_bias=float(rng.uniform(-bias, bias)),
                blockage=float(rng.uniform(0.2, 1.0)) if index == blocked else 0.0,
                lost=(max(start, 0.0), min(max(start + float(rng.uniform(0.1, 1.0)), 0.0), 1.0)) if index == faulty else (0.0, 0.0),
            )
        )
    return tuple(corners)


def _motion(rng: np.random.Generator) -> MotionErrors:
    return MotionErrors(
        period=float(rng.choice((0.010, 0.020))),
        wheel_scale=1.0 + float(rng.uniform(-0.01, 0.01)),
        wheel_uneven=tuple(rng.uniform(-0.003, 0.003, 4).tolist()),
        slip=float(rng.uniform(0.0, 0.005)),
        wheel_sigma=_log(rng, 0.002, 0.02),
        wheel_step=_log(rng, 0.0014, 0.03),
        standstill=float(rng.uniform(0.3, 0.9)) if rng.uniform() < 0.4 else 0.0,
        wheel_latency=float(rng.uniform(0.0, 0.010)),
        yaw_bias=math.radians(_log(rng, 0.02, 0.5)) * float(rng.choice((-1.0, 1.0))),
        yaw_sigma=math.radians(rng.uniform(0.05, 0.15)),
        yaw_scale=1.0 + float(rng.uniform(-0.01, 0.01)),
        yaw_step=_log(rng, 0.0001, 0.001),
        yaw_latency=float(rng.uniform(0.010, 0.030)),
    )


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform between two positive numbers."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))
