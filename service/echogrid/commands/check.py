"""`echogrid check`: what a configuration and a recording are worth: rates, gaps, counters, complete scans per radar."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from echogrid.can.signals import SignalReader, bus_of
from echogrid.commands.traffic import Traffic
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.core.messages import RadarScan, Speed
from echogrid.errors import EchogridError
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline


def command(config_path: Path, log: Path | None) -> None:
    """Prints what was found. Raises EchogridError where the configuration or the log is not good."""
    config = load_config(config_path)
    readers = Pipeline(config, config_path).signals.readers
    print(f"{config_path}: {len(config.radar)} radars and ego motion on {len(config.bus)} buses, {len(readers)} ids are read")
    if log is None:
        return
    report = check_log(config, config_path, log)
    print(render(report))
    complaints = report.complaints()
    if report.torn is not None:
        raise EchogridError("; ".join([str(report.torn), *complaints]))
    if complaints:
        raise EchogridError(f"{log}: " + "; ".join(complaints))
    print(f"{log}: nothing is missing")


@dataclass(slots=True)
class Stream:
    """One radar's scans, or one motion signal: when they were measured, and how many detections they had."""

    stamps_ns: list[int] = field(default_factory=list)
    detections: list[int] = field(default_factory=list)

    @property
    def rate_hz(self) -> float:
        """Over the median step, so that a gap does not lower it; over all where times repeat; 0 for fewer than two."""
        if len(self.stamps_ns) < 2:
            return 0.0
        step_ns = float(np.median(self._steps_ns))
        span_ns = max(self.stamps_ns) - min(self.stamps_ns)
        return 1e9 / step_ns if step_ns > 0 else (len(self.stamps_ns) - 1) * 1e9 / span_ns if span_ns else 0.0

    @property
    def longest_gap(self) -> float:
        """Seconds between two neighbours."""
        return float(self._steps_ns.max()) * 1e-9 if len(self.stamps_ns) > 1 else 0.0

    @property
    def _steps_ns(self) -> np.ndarray:
        return np.diff(np.array(self.stamps_ns, dtype=np.int64))


@dataclass(slots=True)
class Report:
    """What a recording holds for a configuration."""

    health: Health
    log: Log
    traffic: Traffic
    torn: EchogridError | None  # what the file lost
    speed: Stream
    yaw_rate: Stream
    radars: dict[str, Stream]

    def complaints(self) -> list[str]:
        """What keeps this recording from making a good map, one sentence each; empty if nothing does."""
        said = self.log.times.faults() + self.traffic.coarse(self.log.times)
        if not all(stream.stamps_ns for stream in (self.speed, self.yaw_rate, *self.radars.values())):
            said += self.traffic.strangers()
        said += [f"no {name} was decoded" for name, stream in (("speed", self.speed), ("yaw rate", self.yaw_rate)) if not stream.stamps_ns]
        for name, stream in self.radars.items():
            counts = self.health.sensors[name]
            if not stream.stamps_ns:
                said.append(f"radar '{name}' has no complete scan ({counts.incomplete} incomplete, {counts.bad_crc} with a wrong checksum)")
            elif counts.incomplete + counts.bad_crc > 0.01 * len(stream.stamps_ns):
                said.append(f"radar '{name}' lost {counts.incomplete + counts.bad_crc} of its scans, {len(stream.stamps_ns)} are complete")
        for name, stream in (("speed", self.speed), ("yaw rate", self.yaw_rate), *self.radars.items()):
            if stream.longest_gap > 0.5:
                said.append(f"'{name}' is silent for {stream.longest_gap:.1f} s")
        if self.health.bad_frames:
            said.append(f"{self.health.bad_frames} frames are bad (length, checksum, counter, value or time)")
        return said


def check_log(config: Config, source: Path, path: Path) -> Report:
    """Decodes a recording without mapping it. Raises EchogridError where nothing of it can be read."""
    health = Health()
    reader = SignalReader(config, source, health)
    log, traffic = Log(path), Traffic(config, reader)
    speed, yaw_rate = Stream(), Stream()
    radars: dict[str, Stream] = {radar.name: Stream() for radar in config.radar}
    torn: EchogridError | None = None
    try:
        for message in log:
            bus = bus_of(message, config.bus)
            traffic.add(bus, message)
            for item in reader.add(bus or "", message):
                if isinstance(item, RadarScan):
                    radars[item.sensor].stamps_ns.append(item.stamp_ns)
                    radars[item.sensor].detections.append(len(item))
                else:
                    (speed if isinstance(item, Speed) else yaw_rate).stamps_ns.append(item.stamp_ns)
    except EchogridError as error:
        if not log.messages:
            raise
        torn = error
    return Report(health, log, traffic, torn, speed, yaw_rate, radars)


def render(report: Report) -> str:
    """The report as lines of text."""
    health = report.health
    lines = [f"{health.frames} frames in {report.log.times.seconds:.1f} s, {health.unknown_frames} of other ids, "]
    lines[0] += f"{health.bad_frames} bad, {health.lost_frames} missing by their counters"
    if beside := report.log.account.summary():
        lines.append(f"not data frames: {beside}")
    lines += report.log.account.notes + report.log.times.notes()
    row = "{:<14}{:>8}{:>9}{:>10}{:>12}{:>10}{:>9}{:>12}".format
    lines.append(row("", "rate", "complete", "gap", "incomplete", "repeated", "bad crc", "detections"))
    for name, stream in (("speed", report.speed), ("yaw rate", report.yaw_rate)):
        lines.append(row(name, f"{stream.rate_hz:.1f} Hz", len(stream.stamps_ns), f"{stream.longest_gap * 1e3:.0f} ms", "", "", "", ""))
    for name, stream in report.radars.items():
        counts = health.sensors[name]
        median = f"{np.median(stream.detections):.0f}" if stream.detections else "-"
        gap = f"{stream.longest_gap * 1e3:.0f} ms"
        lines.append(
            row(name, f"{stream.rate_hz:.1f} Hz", len(stream.stamps_ns), gap, counts.incomplete, counts.repeated, counts.bad_crc, median)
        )
    if unread := report.traffic.unread.most_common(6):
        most = ", ".join(f"{bus or channel} 0x{frame_id:X} ({count})" for (bus, channel, (frame_id, _)), count in unread)
        lines.append(f"other ids, most frequent first: {most}")
    return "\n".join(lines)
