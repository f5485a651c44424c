"""What a recording's frames are to a configuration, where they are not what it reads."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import FrameId
from echogrid.can.intake.frames import ERROR, EXTENDED, FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS
from echogrid.can.motion import MotionReader
from echogrid.can.radar import RadarReader
from echogrid.can.signals import SignalReader
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.logs.formats.times import Times

MOST_IDS = 1 << 16  # that are counted; garbage has more
MOST_REPEATED = 0.3  # of the frames of ego motion: what has the time of the sample before it moves no car


class Traffic:
    """Remembers frames that nobody reads by channel and id, and frames of ego motion that have the time of the one before."""

    def __init__(self, config: Config, signals: SignalReader) -> None:
        self.unread: Counter[tuple[str | None, str | int, FrameId]] = Counter()  # bus, None where the channel is none of them
        self.motion = self.repeated = 0
        self._config = config
        self._readers = signals.readers
        self._newest: dict[FrameId, float] = {}
        self._heard: set[tuple[str, FrameId]] = set()  # that are read

    def take(self, batch: FrameBatch, buses: NDArray[np.int64]) -> None:
        """Frames (N,) of the recording, and their buses as of `buses_of`."""
        keys = np.stack((buses, batch.channels, batch.ids, batch.flags & EXTENDED), axis=1)[batch.flags & ERROR == 0]
        stamps = batch.stamps[batch.flags & ERROR == 0]
        unique, which, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        for number, ((bus_number, channel_number, code, extended), count) in enumerate(zip(unique.tolist(), counts.tolist(), strict=True)):
            bus = None if bus_number == UNKNOWN_BUS else self._config.bus[bus_number].name
            frame_id, channel = (code, extended != 0), batch.channel(channel_number)
            if bus is None or (bus, frame_id) not in self._readers:
                key = bus, channel if isinstance(channel, int) else str(channel or ""), frame_id
                if key in self.unread or len(self.unread) < MOST_IDS:
                    self.unread[key] += count
                continue
            self._heard.add((bus, frame_id))
            if isinstance(self._readers[bus, frame_id], MotionReader):
                times = stamps[which.reshape(-1) == number]
                self.motion += count
                self.repeated += int((np.diff(times) == 0).sum()) + (self._newest.get(frame_id) == float(times[0]))
                self._newest[frame_id] = float(times[-1])

    @property
    def heard(self) -> bool:
        """Whether any frame is one that is read, sound or not."""
        return bool(self._heard)

    def nothing_known(self, configuration: Path, health: Health) -> str:
        """What to say where no frame is one that is read."""
        expected = sorted({f"0x{frame_id:X}" for _, (frame_id, _) in self._readers})
        found = sorted({frame_id for _, _, (frame_id, _) in self.unread})[:8]
        why = "; ".join(self.strangers()) or (
            f"found ids {', '.join(f'0x{frame_id:X}' for frame_id in found)} …, expected {', '.join(expected[:8])} …"
        )
        return f"none of its {health.frames} frames is one that {configuration} knows: {why}"

    def why_no_map(self, health: Health, reasons: Sequence[str]) -> str:
        """What is missing where frames are read and none gave a map; `reasons`: of the map's state at the end."""
        scans = sum(sensor.complete for sensor in health.sensors.values())
        bad = health.bad_frames
        said = [f"{bad} frames are bad: too short, or with a wrong checksum, counter, value or time"] if bad else []
        said += [reason for reason in reasons if not reason.startswith("no map yet")]
        return "; ".join([f"it has {scans} complete scans and {self.motion} frames of ego motion", *said, *self.strangers()])

    def coarse(self, times: Times) -> list[str]:
        """Says so where times do not tell frames of ego motion apart: nothing moves between two of the same time."""
        if times.seconds == 0 or self.repeated <= MOST_REPEATED * self.motion:
            return []
        repeated = f"{self.repeated} of {self.motion} frames of ego motion have the time of the one before"
        if times.finest < times.seconds * len(self._newest) / self.motion:  # finer than these frames come
            return [f"its times do not tell its frames apart: {repeated}; they are there twice, or were stamped many at once"]
        return [f"its times are too coarse: they go on in steps of {times.finest:.3g} s, and {repeated}"]

    def strangers(self) -> list[str]:
        """Why frames are not read whose ids are read but were not heard: their channel is another, or not said, or their ids' length is."""
        missed = {key for key in self._readers if key not in self._heard}
        expected = {frame_id for _, frame_id in missed}
        said = []
        for channel in dict.fromkeys(channel for bus, channel, _ in self.unread if bus is None):
            fitting = {frame_id for bus, other, frame_id in self.unread if bus is None and other == channel} & expected
            if not fitting:
                continue
            if channel == "":
                said.append("the recording does not say channels, so its buses cannot be told apart")
                continue
            fits = Counter(bus for bus, frame_id in missed if frame_id in fitting)
            bus = next(bus for bus in self._config.bus if bus.name == fits.most_common(1)[0][0])
            shown = str(channel) if isinstance(channel, int) else f'"{channel}"'
            said.append(
                f"frames with ids that are read are of channel {shown.replace(chr(34), chr(39))}, expected '{bus.logged_as}': "
                f"give log_channel = {shown} to the bus '{bus.name}'"
            )
        if not said:  # with its channel put right, a bus may be another
            said += self._on_other_buses(missed)
        found = {frame_id for _, _, frame_id in self.unread} - expected
        longer = sorted(number for number, extended in found if (number, not extended) in expected)
        if longer:
            extended = (longer[0], False) in expected
            lengths = ("29", "11") if extended else ("11", "29")
            said.append(f"ids such as 0x{longer[0]:X} are there with {lengths[0]} bits, expected with {lengths[1]}")
        return said

    def _on_other_buses(self, missed: set[tuple[str, FrameId]]) -> list[str]:
        """Readers that heard nothing on their bus, and whose ids are on another that is configured."""
        said = []
        for reader in dict.fromkeys(self._readers.values()):
            own = {key for key, one in self._readers.items() if one is reader}
            if not own <= missed:
                continue
            (bus,) = {bus for bus, _ in own}
            ids = {frame_id for _, frame_id in own}
            there = Counter(other for other, _, frame_id in self.unread if other not in (None, bus) and frame_id in ids)
            if there:
                other = "[motion]" if isinstance(reader, MotionReader) else "[pose]"
                table = f"[[radar]] {reader.sensor}" if isinstance(reader, RadarReader) else other
                first = min(number for number, _ in ids)
                said.append(
                    f"ids such as 0x{first:X} are on bus '{there.most_common(1)[0][0]}', expected on '{bus}': give that bus to {table}"
                )
        return said
