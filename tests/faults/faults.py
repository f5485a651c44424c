"""Every fault: how it changes the frames from a time to another, and what the service must say of it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from echogrid.core.trust.watch import State
from tests.faults.drive import (
    RADARS,
    WHEELS,
    YAW_RATE,
    Frame,
    cycle_with,
    cycles_of,
    motion_with,
    wheels_of,
    yaw_rate_of,
)

Frames = tuple[Frame, ...]
Change = Callable[[Frames, float, float, np.random.Generator], Iterable[Frame]]  # frames, from, until (s), what else is random


@dataclass(frozen=True, slots=True)
class Fault:
    """`states` and `reason` (a pattern): one of these, with this reason, must be reached. Without states a new map is what must be
    seen, or nothing at all where there may be none.

    `new_map`: whether the map must begin anew. `notice` and `recover`: seconds that it may take. `pose` (m): how far poses may be off
    before it is noticed.
    """

    name: str
    change: Change
    states: tuple[str, ...] | None
    reason: str = ""
    new_map: bool = False
    notice: float = 1.1
    recover: float = 0.2
    pose: float = 0.05
    lasts: float | None = None  # s; None: as long as the experiment likes

    def is_noticed(self, state: State, epoch: int) -> bool:
        if not self.states:
            return self.new_map and epoch > 0
        return state.name in self.states and any(re.search(self.reason, reason) for reason in state.reasons)


def _radars(random: np.random.Generator, count: int) -> list[int]:
    return sorted(random.choice(len(RADARS), size=count, replace=False).tolist())


def _where(
    frames: Frames, start: float, end: float, change: Callable[[Frame], Frame | None], which: Callable[[Frame], bool]
) -> list[Frame]:
    """Each frame of the fault's time that is meant, changed or left out."""
    changed = [change(frame) if start <= frame.time < end and which(frame) else frame for frame in frames]
    return [frame for frame in changed if frame is not None]


def _cycles(frames: Frames, start: float, end: float, radar: int, change: Callable[[list[Frame]], list[Frame]]) -> list[Frame]:
    """Each whole cycle of a radar in the fault's time, changed."""
    kept = [frame for frame in frames if frame.radar != radar]
    for cycle in cycles_of(frames, radar):
        kept += change(cycle) if start <= cycle[0].time < end else cycle
    return sorted(kept, key=lambda frame: frame.time)


def lost(count: int, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    which = _radars(random, count)
    return _where(frames, start, end, lambda frame: None, lambda frame: frame.radar in which)


def intermittent(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle if random.random() < 0.4 else [])


def torn(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """Frames of the cycles get lost."""
    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle if random.random() < 0.4 else cycle[:-1])


def frozen(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The same detections again and again, in new cycles with good checksums."""
    (radar,) = _radars(random, 1)
    first = next(cycle for cycle in cycles_of(frames, radar) if cycle[0].time >= start)

    def repeat(cycle: list[Frame]) -> list[Frame]:
        counter = cycle[0].message.data[0]
        copies = [Frame(cycle[0].time + k * 4e-4, frame.stamped(cycle[0].time - first[0].time).message) for k, frame in enumerate(first)]
        return cycle_with(copies, {"CycleCounter": counter}, lambda values: {**values, "CycleCounter": counter})

    return _cycles(frames, start, end, radar, repeat)


def says_blocked(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, {"Blockage": 80, "DetectionCount": 4}))


def blind(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """Next to no detections, and it does not say why."""
    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, {"DetectionCount": int(random.integers(0, 3))}))


def swapped(pair: tuple[int, int], frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    other = {pair[0]: pair[1], pair[1]: pair[0]}

    def swap(frame: Frame) -> Frame:
        return frame.of_radar(other[frame.radar]) if frame.radar in other else frame

    return _where(frames, start, end, swap, lambda frame: frame.radar in other)


def mirrored(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The azimuth's sign is wrong."""

    def turn(values: dict[str, Any]) -> dict[str, Any]:
        return {key: -value if key.startswith("Azimuth") else value for key, value in values.items()}

    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, change=turn))


def miscounted(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The cycle counter stands still."""

    def stand(cycle: list[Frame]) -> list[Frame]:
        return cycle_with(cycle, {"CycleCounter": 7}, lambda values: {**values, "CycleCounter": 7})

    return _cycles(frames, start, end, *_radars(random, 1), stand)


def miscounted_pages(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The detection frames' counter is not their header's."""

    def shift(values: dict[str, Any]) -> dict[str, Any]:
        return {**values, "CycleCounter": (values["CycleCounter"] + 1) % 256}

    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, change=shift))


def out_of_range(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """Whatever the bits can say, all of it flagged as valid."""
    lowest = {"Range": 0.0, "Azimuth": -1.6384, "RangeRate": -81.92}
    highest = {"Range": 255.98, "Azimuth": 1.6382, "RangeRate": 81.91}

    def scramble(values: dict[str, Any]) -> dict[str, Any]:
        return {
            key: random.uniform(lowest[name], highest[name]) if (name := key.split("_")[0]) in lowest else value
            for key, value in values.items()
        }

    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, change=scramble))


def too_old(age_ms: float, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The age that it reports is wrong, so that its scans are placed where the car was before."""
    return _cycles(frames, start, end, *_radars(random, 1), lambda cycle: cycle_with(cycle, {"MeasurementAge": age_ms}))


def delayed(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """They lie about somewhere on their way, with the age that they always have."""
    (radar,) = _radars(random, 1)
    newest, late = 0.0, []
    for frame in frames:
        if frame.radar == radar:
            newest = max(newest + 1e-4, frame.time + (0.3 if start <= frame.time < end else 0.0))  # what comes after waits for them
            late.append(frame.later(newest - frame.time))
        else:
            late.append(frame)
    return sorted(late, key=lambda frame: frame.time)


def motion_lost(which: tuple[int, ...], frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _where(frames, start, end, lambda frame: None, lambda frame: frame.message.arbitration_id in which)


def invalid_wheels(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """The sensor itself says that its values are none."""
    return _where(
        frames, start, end, lambda frame: motion_with(frame, WheelSpeedRLValid=0), lambda frame: frame.message.arbitration_id == WHEELS
    )


def _speed(frames: Frames, start: float, end: float, change: Callable[[float], float]) -> list[Frame]:
    def faster(frame: Frame) -> Frame:
        left, right = wheels_of(frame)
        more = change((left + right) / 2) - (left + right) / 2
        return motion_with(frame, WheelSpeedRL=left + more, WheelSpeedRR=right + more)

    return _where(frames, start, end, faster, lambda frame: frame.message.arbitration_id == WHEELS)


def _yaw_rate(frames: Frames, start: float, end: float, change: Callable[[float], float]) -> list[Frame]:
    return _where(
        frames,
        start,
        end,
        lambda frame: motion_with(frame, YawRate=change(yaw_rate_of(frame))),
        lambda frame: frame.message.arbitration_id == YAW_RATE,
    )


def speed_stuck(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    left, right = next(wheels_of(frame) for frame in frames if frame.time >= start and frame.message.arbitration_id == WHEELS)
    return _where(
        frames,
        start,
        end,
        lambda frame: motion_with(frame, WheelSpeedRL=left, WheelSpeedRR=right),
        lambda frame: frame.message.arbitration_id == WHEELS,
    )


def speed_spikes(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _speed(frames, start, end, lambda speed: speed + random.uniform(5, 60) if random.random() < 0.2 else speed)


def speed_steps(by: float, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _speed(frames, start, end, lambda speed: speed + by)


def speed_drifts(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """Drifts away, slowly enough for a car: at 4 m/s²."""
    times = iter([frame.time for frame in frames if start <= frame.time < end and frame.message.arbitration_id == WHEELS])
    return _speed(frames, start, end, lambda speed: speed + 4.0 * (next(times) - start))


def yaw_rate_stuck(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    stuck = next(yaw_rate_of(frame) for frame in frames if frame.time >= start and frame.message.arbitration_id == YAW_RATE)
    return _yaw_rate(frames, start, end, lambda _: stuck)


def yaw_rate_spikes(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _yaw_rate(frames, start, end, lambda rate: random.uniform(-6, 6) if random.random() < 0.2 else rate)


def yaw_rate_steps(frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return _yaw_rate(frames, start, end, lambda rate: rate + 1.0)


def clock_steps(by: float, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """And stays so."""
    return [frame.stamped(by) if frame.time >= start else frame for frame in frames]


def stray(by: float, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    """One frame with another clock's time."""
    number = next(n for n, frame in enumerate(frames) if frame.time >= start)
    return [*frames[:number], frames[number].stamped(by), *frames[number + 1 :]]


def gap(seconds: float, frames: Frames, start: float, end: float, random: np.random.Generator) -> Iterable[Frame]:
    return [frame for frame in frames if not start <= frame.time < start + seconds]


D, N, S = ("degraded",), ("no_motion",), ("stale",)
FAULTS = (
    Fault("one radar lost", partial(lost, 1), D, "silent for"),
    Fault("two radars lost", partial(lost, 2), D, "silent for"),
    Fault("three radars lost", partial(lost, 3), D, "silent for"),
    Fault("all radars lost", partial(lost, 4), S, "silent for"),
    Fault("a radar loses 60 % of its scans", intermittent, D, "of its scans come whole|silent for", notice=4.2, recover=4.2),
    Fault("a radar loses frames of 60 % of its scans", torn, D, "incomplete scans", notice=4.2, recover=4.2),
    Fault("a radar frozen", frozen, D, "frozen"),
    Fault("a radar blocked, and says so", says_blocked, D, "blocked: it says so"),
    Fault("a radar blocked, unsaid", blind, D, "blocked: it sees", notice=3.0, recover=0.6),
    Fault("front radars swapped", partial(swapped, (0, 1)), D, "at odds", notice=2.5, recover=2.5),
    Fault("left radars swapped", partial(swapped, (0, 2)), D, "at odds", notice=2.5, recover=2.5),
    Fault("radars swapped across", partial(swapped, (1, 2)), D, "at odds", notice=2.5, recover=2.5),
    Fault("a radar's azimuth mirrored", mirrored, D, "at odds", notice=2.5, recover=2.5),
    Fault("a radar's cycle counter stands", miscounted, D, "repeated frames"),
    Fault("a radar's frames miscounted", miscounted_pages, D, "frames of a wrong cycle"),
    Fault("a radar's values out of range", out_of_range, D, "out of range", notice=2.5, recover=1.6),
    Fault("a radar's scans said to be 120 ms old", partial(too_old, 120.0), D, "shifted in time"),
    Fault("a radar's scans said to be 600 ms old", partial(too_old, 600.0), D, "late scans"),
    Fault("a radar's frames 0.3 s late", delayed, D, "shifted in time", recover=1.0),
    Fault("wheel speed lost", partial(motion_lost, (WHEELS,)), N, "wheel speed: silent", True, pose=0.3),
    Fault("yaw rate lost", partial(motion_lost, (YAW_RATE,)), N, "yaw rate: silent", True, pose=0.3),
    Fault("all ego motion lost", partial(motion_lost, (WHEELS, YAW_RATE)), N, "silent", True),
    Fault("wheel speed invalid", invalid_wheels, N, "wheel speed: silent", True, pose=0.3),
    Fault("wheel speed stuck", speed_stuck, N, "wheel speed: (is stuck|says)", True, notice=2.5, recover=1.5, pose=2.0),
    Fault("wheel speed jumps, one sample in five", speed_spikes, D, "wheel speed: jumps", recover=1.1, pose=0.3),
    Fault("wheel speed steps by 10 m/s", partial(speed_steps, 10.0), N, "wheel speed: (jumps|jumped)", True, recover=2.0, pose=0.3),
    Fault("wheel speed drifts off", speed_drifts, N, "wheel speed: says", True, notice=2.5, recover=1.6, pose=2.0),
    Fault("yaw rate stuck", yaw_rate_stuck, N, "yaw rate: (is stuck|says)", True, notice=3.5, recover=1.5, pose=2.0),
    Fault("yaw rate jumps, one sample in five", yaw_rate_spikes, D, "yaw rate: jumps", recover=1.1, pose=0.3),
    Fault("yaw rate steps by 1 rad/s", yaw_rate_steps, N, "yaw rate: (jumps|jumped)", True, recover=2.0, pose=0.3),
    Fault("clock set forward by an hour", partial(clock_steps, 3600.0), None, "", True, lasts=0.0),
    Fault("clock set back by an hour", partial(clock_steps, -3600.0), S, "nothing received", True, recover=1.5, lasts=0.0),
    Fault("clock set forward by 0.3 s", partial(clock_steps, 0.3), N, "silent", True, recover=0.4, lasts=0.0),  # or frames that waited
    Fault("clock set back by 0.3 s", partial(clock_steps, -0.3), None, "", True, recover=0.5, lasts=0.0),
    Fault("one frame an hour old", partial(stray, -3600.0), None, lasts=0.0),
    Fault("one frame an hour ahead", partial(stray, 3600.0), None, lasts=0.0),
    Fault("bus silent for 0.3 s", partial(gap, 0.3), None, lasts=0.3, pose=0.3),
    Fault("bus silent for 2 s", partial(gap, 2.0), S, "nothing received", True, lasts=2.0),
)
