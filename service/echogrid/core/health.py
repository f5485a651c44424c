"""Counters of all that went wrong, and of all that went right. Nothing is dropped without adding to one of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field


@dataclass(slots=True)
class SensorHealth:
    """One radar's counters since the start. Scans are `complete` (some of them `distrusted`), `incomplete` or `late`; the rest are
    frames or detections."""

    complete: int = 0
    incomplete: int = 0  # frames, or detections that the header counts, were missing when the next cycle began or the time-out passed
    late: int = 0  # complete, but too old to be placed, or not newer than the last one
    repeated: int = 0  # frames, headers or whole cycles received twice
    wrong_cycle: int = 0  # detection frames that belong to no open cycle
    bad_crc: int = 0  # cycles, or single frames where each has its own, whose checksum is wrong
    invalid: int = 0  # detections flagged invalid by the sensor, or with a value that is not a number
    distrusted: int = 0  # complete scans that were left out of the map, since the radar was not trusted
    truncated: int = 0  # detections beyond `max_detections`, the farthest first

    def as_dict(self) -> dict[str, int]:
        """For reports."""
        return asdict(self)


@dataclass(slots=True)
class PoseHealth:
    """Poses from outside, since the start."""

    taken: int = 0  # that placed odom in the map frame
    invalid: int = 0  # no numbers, flagged invalid by the sender, or too far away
    old: int = 0  # not newer than the last one
    untimely: int = 0  # of a time at which the car's own motion is not known, or not any more
    jumped: int = 0  # that lay far off where dead reckoning had gone since the last one, and were not believed
    moved: int = 0  # times that such poses agreed for long enough to be believed


@dataclass(slots=True)
class Health:
    """Counters of one run of the service or one replay."""

    frames: int = 0
    unknown_frames: int = 0  # ids that the configuration does not name: normal on a shared bus
    bad_frames: int = 0  # too short, remote, wrong checksum, repeated counter, no number, back in time
    lost_frames: int = 0  # by the counters of motion messages: how many are missing
    motion_dropped: int = 0  # ego motion not newer than the last one
    motion_implausible: int = 0  # ego motion that no car can show
    clock_steps: int = 0  # times that the traffic's clock was set back
    cycles: int = 0
    scans_without_pose: int = 0  # before the first ego motion, or while it was lost
    detections: int = 0
    static_detections: int = 0
    tiles_forgotten: int = 0
    sensors: dict[str, SensorHealth] = field(default_factory=dict)
    pose: PoseHealth = field(default_factory=PoseHealth)
