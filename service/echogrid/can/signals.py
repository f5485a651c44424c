"""CAN messages in; scans, ego motion and poses from outside out: who reads which id on which bus."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import can

from echogrid.can.dbc import Dbc
from echogrid.can.motion import MotionReader
from echogrid.can.pose import PoseReader
from echogrid.can.profile import MotionProfile, PoseProfile, RadarProfile, find, load_motion, load_pose, load_radar
from echogrid.can.radar import FrameId, RadarReader
from echogrid.config.tables import Bus, Config
from echogrid.core.health import Health, SensorHealth
from echogrid.core.messages import EgoMotion, PoseFix, RadarScan
from echogrid.errors import EchogridError

Reader = RadarReader | MotionReader | PoseReader
NOTHING = ()
STEP_NS = 1_000_000_000  # a frame that is older or newer than the newest by more was not reordered: it is a stray, or time has stepped
BACK_FOR_NS = 1_000_000_000  # if frames stay older than the newest one for so long, the clock was set back
AHEAD_FOR = 5  # frames in a row so far after it: there was a pause, or the clock was set forward


class TrafficTime:
    """Remembers the newest frame's time, and a run of frames that disagree with it. One stray frame moves nothing."""

    def __init__(self) -> None:
        self.newest_ns: int | None = None
        self.set_back = 0  # how many times
        self._run_ns: tuple[int, int] | None = None  # first and newest of the frames that disagree
        self._run = 0

    def takes(self, received_ns: int) -> bool:
        """Whether a frame's time can be trusted."""
        newest_ns = self.newest_ns
        if newest_ns is None or -STEP_NS <= received_ns - newest_ns <= STEP_NS:
            if newest_ns is None or received_ns > newest_ns:
                self.newest_ns = received_ns
            self._run_ns = None
            return True
        if self._run_ns is None or abs(received_ns - self._run_ns[1]) > STEP_NS:
            self._run_ns, self._run = (received_ns, received_ns), 0
        self._run_ns = self._run_ns[0], max(received_ns, self._run_ns[1])
        self._run += 1
        back = received_ns < newest_ns
        if self.waiting_ns < BACK_FOR_NS if back else self._run < AHEAD_FOR:
            return False
        self.set_back += back
        self.newest_ns, self._run_ns = received_ns, None
        return True

    @property
    def waiting_ns(self) -> int:
        """For how long frames have come that disagree."""
        return 0 if self._run_ns is None else self._run_ns[1] - self._run_ns[0]


class SignalReader:
    """Remembers the half-assembled scans and counters of all sensors, and the time of the traffic."""

    def __init__(self, config: Config, source: Path, health: Health) -> None:
        """`source`: the configuration's file; its relative paths begin in its folder. Raises EchogridError."""
        self.source = source
        self.health = health
        self.time = TrafficTime()
        self.readers: dict[tuple[str, FrameId], Reader] = {}
        with _named(source, "motion"):
            path = find(config.motion.profile, source.parent)
            motion = load_motion(path)
            dbc = Dbc(_dbc_path(motion, config.motion.dbc, path, source), path)
            self._register(config.motion.bus, MotionReader(motion, dbc, config.motion, health), "motion")
        for index, radar in enumerate(config.radar):
            with _named(source, f"radar[{index}]"):
                path = find(radar.profile, source.parent)
                profile = load_radar(path)
                dbc = Dbc(_dbc_path(profile, radar.dbc, path, source), path)
                sensor = health.sensors.setdefault(radar.name, SensorHealth())
                self._register(radar.bus, RadarReader(radar.name, profile, dbc, radar.id_offset, sensor, radar.latency_ms), radar.name)
        if config.pose is not None and config.pose.bus is not None:
            with _named(source, "pose"):
                path = find(str(config.pose.profile), source.parent)
                pose = load_pose(path)
                dbc = Dbc(_dbc_path(pose, config.pose.dbc, path, source), path)
                self._register(config.pose.bus, PoseReader(pose, dbc, config.pose, health.pose), "pose")

    def _register(self, bus: str, reader: Reader, name: str) -> None:
        for frame_id in sorted(reader.ids):
            other = self.readers.setdefault((bus, frame_id), reader)
            if other is not reader:
                taken = other.sensor if isinstance(other, RadarReader) else "motion" if isinstance(other, MotionReader) else "pose"
                raise EchogridError(
                    f"'{taken}' and '{name}' both read id 0x{frame_id[0]:X} on bus '{bus}': give one of them another bus or id_offset"
                )

    @property
    def newest_ns(self) -> int | None:
        """The newest frame's time; None before the first."""
        return self.time.newest_ns

    def ids(self, bus: str) -> list[FrameId]:
        """The ids that are read on a bus, for the kernel's filter."""
        return sorted(frame_id for name, frame_id in self.readers if name == bus)

    def add(self, bus: str, message: can.Message) -> Sequence[RadarScan | EgoMotion | PoseFix]:
        """What a message completes. A bad one changes nothing and is counted; an error frame is not traffic."""
        if message.is_error_frame:
            return NOTHING
        self.health.frames += 1
        # A float of seconds since 1970 holds microseconds, not nanoseconds. Of its fraction, 22 bits, the product is exact, so that it is
        # rounded as in a text log; rounding the whole float would give another microsecond for one frame in eight.
        fraction, seconds = math.modf(message.timestamp)
        received_ns = (int(seconds) * 1_000_000 + round(fraction * 1e6)) * 1000
        if not self.time.takes(received_ns):
            self.health.bad_frames += 1
            return NOTHING
        self.health.clock_steps = self.time.set_back
        reader = self.readers.get((bus, (message.arbitration_id, message.is_extended_id)))
        if reader is None:
            self.health.unknown_frames += 1
            return NOTHING
        if message.is_remote_frame:
            self.health.bad_frames += 1
            return NOTHING
        try:
            if isinstance(reader, RadarReader):
                scan = reader.add(message, received_ns)
                return NOTHING if scan is None else (scan,)
            return reader.add(message, received_ns)
        except ValueError:
            self.health.bad_frames += 1
            return NOTHING


def bus_of(message: can.Message, buses: tuple[Bus, ...]) -> str | None:
    """The bus that a logged message belongs to. Log formats name channels ("can1"), or number them from 1, or do not say.

    A number is that of `log_channel`, or the bus is meant whose name has the number before: 1 is "can0". PCAN_USBBUS1 counts from 1.
    """
    channel = message.channel
    if channel is None or channel == "":
        return buses[0].name if len(buses) == 1 else None
    for bus in buses:
        if str(channel) == str(bus.logged_as) and (isinstance(channel, str) or bus.log_channel is not None):
            return bus.name
        if isinstance(channel, int) and channel == _number(str(bus.logged_as)):
            return bus.name
        if isinstance(channel, str) and isinstance(bus.log_channel, int) and channel == f"can{bus.log_channel}":
            return bus.name
    # A copy of a recording may call the bus by its name; where `log_channel` says another, that holds.
    return next((bus.name for bus in buses if bus.name == channel and bus.log_channel is None), None)


def _number(name: str) -> int | None:
    """What files that number their channels from 1 would call a bus; None for a name without a number."""
    digits = name[len(name.rstrip("0123456789")) :]
    if not digits or digits == name:
        return None
    return int(digits) + (not name.startswith("PCAN_"))


def _dbc_path(profile: RadarProfile | MotionProfile | PoseProfile, override: str | None, path: Path, source: Path) -> Path:
    if override is not None:
        return source.parent / override
    if profile.dbc is None:
        raise EchogridError(f"{path} is shipped without a DBC file: give its path as 'dbc'")
    return path.parent / profile.dbc


@contextmanager
def _named(source: Path, key: str) -> Iterator[None]:
    """Puts the configuration's file and key before what is wrong with what they name."""
    try:
        yield
    except EchogridError as error:
        raise EchogridError(f"{source}: {key}: {error}") from error
