"""CAN messages in; scans, ego motion and poses from outside out: who reads which id on which bus."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path

import can
import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import FrameId
from echogrid.can.dbc import Dbc
from echogrid.can.intake.frames import FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS, Intake, Integers, Item, Reader, Table
from echogrid.can.intake.traffic_time import TrafficTime
from echogrid.can.motion import MotionReader
from echogrid.can.pose import PoseReader
from echogrid.can.profile import MotionProfile, PoseProfile, RadarProfile, find, load_motion, load_pose, load_radar
from echogrid.can.radar import RadarReader
from echogrid.config.tables import Bus, Config
from echogrid.core.health import Health, SensorHealth
from echogrid.core.kernels.scans import NEVER
from echogrid.core.radar.scan import ALWAYS, Assembly, Frames, Span, Taken
from echogrid.errors import EchogridError

Found = tuple[int, Item]  # by which frame


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
        self._numbers = {bus.name: number for number, bus in enumerate(config.bus)}
        self._table = Table(self.readers, self._numbers)
        self._radars = self._table.radars
        self._assembly = Assembly([one.rule for one in self._radars], [one.health for one in self._radars], self._table.known)

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

    def number(self, bus: str) -> int:
        """Of a bus in the configuration; UNKNOWN_BUS for another name."""
        return self._numbers.get(bus, UNKNOWN_BUS)

    def are_motion(self, bus: str, batch: FrameBatch) -> NDArray[np.bool_]:
        """(N,) which of a bus's frames say how the car moves, or where it is."""
        intake = self._table.intake(batch, np.full(len(batch), self.number(bus)))
        found = np.zeros(len(batch), np.bool_)
        found[intake.others] = True
        return found

    def add(self, bus: str, message: can.Message) -> list[Item]:
        """What one message of a bus completes."""
        batch = FrameBatch.of([message])
        return [item for _, found in self.pieces(batch, np.array([self.number(bus)])) for _, item in found]

    def heard(self, batches: Iterable[FrameBatch], buses: tuple[Bus, ...]) -> Iterator[tuple[int, list[Item]]]:
        """What a recording says, whenever time goes on: the traffic's time in ns, 0 before there is one, and what came until then."""

        def now() -> Span:
            return (ALWAYS[0], ALWAYS[0]) if self.newest_ns is None else (self.newest_ns, self.newest_ns + 1)

        for batch in batches:
            for _, found in self.pieces(batch, buses_of(batch, buses), now):
                yield self.newest_ns or 0, [item for _, item in found]

    def pieces(self, batch: FrameBatch, buses: Integers, due: Callable[[], Span] = lambda: ALWAYS) -> Iterator[tuple[int, list[Found]]]:
        """What frames (N,) of buses (N,), by their number in the configuration or UNKNOWN_BUS, complete, by frame and in their order.

        In pieces: each ends behind the frame, which is told, after which the traffic's time is not within `due` any more, that is asked
        at the begin of each. A bad frame changes nothing and is counted; an error frame is not traffic.
        """
        intake = self._table.intake(batch, buses)
        begin, size = 0, len(batch)
        while begin < size:
            taken = self._assembly.take(intake.frames, begin, size, self._newest_ns, due())
            if taken.is_stray and taken.end == begin:
                taken = self._doubt(intake.frames, begin)
            yield taken.end, self._read(intake, begin, taken)
            begin = taken.end

    @property
    def _newest_ns(self) -> int:
        return NEVER if self.time.newest_ns is None else self.time.newest_ns

    def _doubt(self, frames: Frames, at: int) -> Taken:
        """Takes a frame whose time is far off, if it is not a stray."""
        if self.time.takes(int(frames.received_ns[at])):
            return self._assembly.take(frames, at, at + 1, self._newest_ns, ALWAYS)
        self.health.bad_frames += 1
        return Taken(at + 1, NEVER, True, 1, 0, 0, False, [])

    def _read(self, intake: Intake, begin: int, taken: Taken) -> list[Found]:
        health = self.health
        health.frames += taken.frames
        if taken.frames:
            health.clock_steps = self.time.set_back
        if taken.newest_ns == NEVER and taken.frames:
            return []
        if taken.frames:
            self.time.advance(taken.newest_ns)
        health.unknown_frames += taken.unknown
        found = self._others(intake, begin, taken.end)
        for cycle in taken.cycles:
            scan = self._radars[cycle.radar].scan(cycle, int(intake.frames.received_ns[cycle.place]))
            if scan is not None:
                found.append((cycle.place, scan))
        health.bad_frames += taken.remote + (self._assembly.counted() if taken.lost else 0)
        if taken.cycles:
            found.sort(key=_place)
        return found

    def _others(self, intake: Intake, begin: int, end: int) -> list[Found]:
        """What no radar sent, frame by frame."""
        found: list[Found] = []
        others, frames = intake.others, intake.frames
        for n in range(bisect_left(others, begin), bisect_left(others, end)):
            at, (role, received_ns, wrong, values, counted) = others[n], intake.said[n]
            reader, frame_id = self._table.others[role]
            try:
                if wrong:
                    raise ValueError("too short, or a wrong checksum")
                if isinstance(reader, MotionReader):
                    said: Sequence[Item] = reader.read(frame_id, values, counted, received_ns)
                else:
                    first = int(frames.begins[at])
                    said = reader.read(frame_id, frames.data[first : first + int(frames.sizes[at])].tobytes(), received_ns)
            except ValueError:
                self.health.bad_frames += 1
                continue
            for item in said:
                found.append((at, item))
        return found


_place = itemgetter(0)


def buses_of(batch: FrameBatch, buses: tuple[Bus, ...]) -> Integers:
    """(N,) the number of each frame's bus in the configuration, UNKNOWN_BUS where its channel is none of them."""
    numbers: dict[str | None, int] = {None: UNKNOWN_BUS} | {bus.name: number for number, bus in enumerate(buses)}
    channels = batch.channels
    if len(channels) and (channels == channels[0]).all():
        return np.full(len(channels), numbers[bus_of_channel(batch.channel(int(channels[0])), buses)])
    unique, which = np.unique(channels, return_inverse=True)
    found = [numbers[bus_of_channel(batch.channel(number), buses)] for number in unique.tolist()]
    return np.array(found, np.int64)[which]


def bus_of(message: can.Message, buses: tuple[Bus, ...]) -> str | None:
    """The bus that a logged message belongs to."""
    return bus_of_channel(message.channel, buses)


def bus_of_channel(channel: object, buses: tuple[Bus, ...]) -> str | None:
    """The bus that a recording means by a channel. Log formats name channels ("can1"), or number them from 1, or do not say.

    A number is that of `log_channel`, or the bus is meant whose name has the number before: 1 is "can0". PCAN_USBBUS1 counts from 1.
    """
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
