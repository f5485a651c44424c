"""All that a recording says through a configuration's decoder: frames by id, counters, scans and ego motion."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import FrameId
from echogrid.can.intake.frames import ERROR, EXTENDED, FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS
from echogrid.can.motion import MotionReader
from echogrid.can.pose import PoseReader
from echogrid.can.profile import MotionProfile, PoseProfile, RadarProfile, find, load_motion, load_pose, load_radar
from echogrid.can.radar import RadarReader
from echogrid.can.signals import SignalReader, buses_of
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.core.messages import EgoMotion, PoseFix, RadarScan
from echogrid.core.motion.pose_convention import convention
from echogrid.core.radar.scan import FrameKind
from echogrid.judging.by_hypothesis import findings_of_pose
from echogrid.judging.finding import Finding, Undecided
from echogrid.judging.judge import LOST, Judgement, counted, judge
from echogrid.judging.mending import Mender
from echogrid.judging.on_the_way import bias_on_the_way
from echogrid.judging.recorded import NS, Recorded, collect
from echogrid.judging.refining import standing_bias
from echogrid.judging.small_errors import NEEDS_STOP, STANDING, about_bias
from echogrid.judging.traffic import Moved, Owner, judge_traffic

SHORT = 0.5  # share of an owner's frames that are shorter than the DBC says, from which on it is the DBC
MOST_INVALID = 0.9  # share of the places, from which on latitude and longitude may be swapped
SMALL = {
    "wheels_swapped",
    "mount_yaw",
    "time_offset",
    "wheel_scale",
    "blocked",
    "blocked_sector",
    "field_of_view",
}  # findings that disturb nothing else
LIKELY = 1.645  # sigmas: 95 %, of an estimate with all that is known beforehand in it
ON_THE_WAY = "the rear wheels' difference, and standing things that were seen again, over the drive"
SILENCE = 0.5  # s without a sample or scan
SPEED, YAW_RATE, POSE, RECORDING = "speed", "yaw rate", "pose", "recording"
NO_CHANNELS = Finding(
    "no_channels", "the recording does not say channels, so its buses cannot be told apart", 0.0, "", 0.99, "channels of its frames"
)


class Listener:
    """Remembers what was heard. `take` all frames of the recording, then ask."""

    def __init__(self, config: Config, source: Path) -> None:
        """`source`: the configuration's file. Raises EchogridError."""
        self.config = config
        self.health = Health()
        self.reader = SignalReader(config, source, self.health)
        self.heard: Counter[tuple[str, FrameId]] = Counter()
        self.nameless = 0  # frames of no channel, where several buses are configured
        self.short: Counter[str] = Counter()  # frames that are too short, by owner
        self.owned: Counter[str] = Counter()  # frames, by owner
        self.motion: list[EgoMotion] = []
        self.scans: list[RadarScan] = []
        self.poses: list[PoseFix] = []
        self.channels: dict[str, list[str]] = {bus.name: [] for bus in config.bus}
        self.owners, self._lengths = _owners(config, self.reader)
        radars, motion, pose = _profiles(config, source)
        self.mender = Mender(config, radars, motion, {}, self.channels, pose)

    def take(self, batch: FrameBatch) -> NDArray[np.int64]:
        """Frames (N,) of the recording; returns the buses that they belong to, as of `buses_of`."""
        buses = buses_of(batch, self.config.bus)
        keys = np.stack((buses, batch.channels, batch.ids, batch.flags & EXTENDED), axis=1)
        sent = batch.flags & ERROR == 0  # an error frame is no sender's
        unique, which = np.unique(keys, axis=0, return_inverse=True)
        for number, (bus_number, channel_number, code, extended) in enumerate(unique.tolist()):
            bus = None if bus_number == UNKNOWN_BUS else self.config.bus[bus_number].name
            channel, frame_id, mine = batch.channel(channel_number), (code, extended != 0), (which.reshape(-1) == number) & sent
            if bus is not None and str(channel) not in self.channels[bus]:
                self.channels[bus].append(str(channel))
            count = int(np.count_nonzero(mine))
            if not count:
                continue
            if bus is not None or channel not in (None, ""):
                self.heard[str(channel), frame_id] += count
            else:
                self.nameless += count
            owner = self._lengths.get((bus or "", frame_id))
            if owner is not None:
                self.owned[owner[0]] += count
                self.short[owner[0]] += int(np.count_nonzero(batch.sizes[mine] < owner[1]))
        for _, found in self.reader.pieces(batch, buses):
            for _, item in found:
                if isinstance(item, RadarScan):
                    self.scans.append(item)
                elif isinstance(item, PoseFix):
                    self.poses.append(item)
                else:
                    self.motion.append(item)
        return buses

    def recorded(self) -> Recorded:
        """As arrays."""
        return collect(self.motion, self.scans, {radar.name: radar.mount() for radar in self.config.radar})

    def judged(self) -> tuple[Judgement, list[Finding], Mender]:
        """What Doppler says; all findings, those of traffic and counters first; and who knows their fixes."""
        recorded = self.recorded()
        if self.nameless and not self.heard:
            return judge(recorded, {}), [NO_CHANNELS], self.mender
        about_traffic, moved = judge_traffic(self.owners, self.heard, self.channels)
        about_traffic += self._lengths_and_counters(recorded, {name for one in about_traffic for name in (*one.radars, one.subject)}, moved)
        settings = {radar.name: f"{radar.profile} {radar.dbc}" for radar in self.config.radar}
        judgement = self._with_bias(judge(recorded, settings), recorded)
        about_pose: list[Finding] = []
        if self.config.pose is not None and self.config.pose.key is not None:
            sentence = f"pose: not judged: it comes over Zenoh, by {self.config.pose.key}, which CAN frames do not show"
            judgement = replace(judgement, undecided=(*judgement.undecided, Undecided("needs_can_pose", sentence)))
        elif not any(one.code.startswith(("speed_", "yaw_rate_sign", "yaw_rate_unit", "byte_order")) for one in judgement.findings):
            about_pose, missing = self._pose(recorded)  # else it is not the pose that is wrong
            judgement = replace(judgement, undecided=(*judgement.undecided, *missing))
        return judgement, [*about_traffic, *judgement.findings, *about_pose], replace(self.mender, moved=moved)

    def _with_bias(self, judgement: Judgement, recorded: Recorded) -> Judgement:
        """With what is said of the yaw rate's bias where Doppler does not say it better, and nothing gross is wrong."""
        told = judgement.errors is not None and judgement.errors.standing is not None
        if told or not len(recorded.speed) or not len(recorded.yaw_rate) or {one.code for one in judgement.findings} - SMALL:
            return judgement
        standing = standing_bias(recorded.speed, recorded.yaw_rate)
        if standing is not None:
            found, missing = about_bias(standing, STANDING)
        else:
            mounts = {radar.name: radar.mount() for radar in self.config.radar}
            found, missing = about_bias(bias_on_the_way(self.motion, self.scans, mounts, self.config.gate.noise()), ON_THE_WAY, LIKELY)
        undecided = [one for one in judgement.undecided if one.code != NEEDS_STOP]
        return replace(judgement, findings=(*judgement.findings, *found), undecided=(*undecided, *missing))

    def _pose(self, recorded: Recorded) -> tuple[list[Finding], list[Undecided]]:
        """The pose from outside beside the car's own motion."""
        pose, invalid = self.config.pose, self.health.pose.invalid
        reader = next((one for one in self.reader.readers.values() if isinstance(one, PoseReader)), None)
        if pose is None or reader is None:
            return [], []
        if invalid > MOST_INVALID * max(len(self.poses) + invalid, 1) and reader.swapped():
            sentence = (
                f"pose: {invalid} of its places are far from the origin, and near it with latitude and longitude in each other's place"
            )
            return [Finding("pose_swapped", sentence, float(invalid), "poses", 0.99, "the newest place", subject=POSE)], []
        poses = sorted(self.poses, key=lambda one: one.stamp_ns)
        told = [((one.stamp_ns - recorded.begin_ns) * NS, one.x, one.y, (one.yaw_ns - recorded.begin_ns) * NS, one.yaw) for one in poses]
        time, speed = recorded.speed.time, recorded.speed.value
        motion = np.stack((time, speed, recorded.yaw_rate.at(time)), axis=1)
        found = convention(motion, np.array(told).reshape(-1, 5), pose.base_from_point()) if len(recorded.yaw_rate) else None
        return ([], []) if found is None else findings_of_pose(found, len(poses))

    def _lengths_and_counters(self, recorded: Recorded, explained: set[str], moved: dict[str, Moved]) -> list[Finding]:
        """What is not explained by frames that are not there."""
        found = []
        for owner in self.owners:
            share = self.short[owner.name] / max(self.owned[owner.name], 1)
            if share > SHORT and owner.name not in moved:
                sentence = f"{owner.name}: {share:.0%} of its frames are shorter than the DBC says: another version"
                radars, subject = ((owner.name,), "") if owner.radar else ((), owner.name)
                found.append(Finding("wrong_length", sentence, share, "of its frames", 0.99, "lengths", radars, subject))
                explained.add(owner.name)
        whole = sum(self.owned[name] for name in (SPEED, YAW_RATE))
        bad = 1 - len(self.motion) / whole if whole and not explained & {SPEED, YAW_RATE} else 0.0
        lost = self.health.lost_frames / max(self.health.lost_frames + whole, 1)
        gone = {owner.name for owner in self.owners if owner.name in moved or owner.name in explained}
        for one in counted(recorded, self.health.sensors, bad, lost):
            if not gone & set(one.radars):
                found.append(one)
        times = {SPEED: recorded.speed.time, YAW_RATE: recorded.yaw_rate.time} | {radar.name: radar.time for radar in recorded.radars}
        for name, time in times.items():
            steps = recorded.steps(time)
            longest = float(steps.max()) if len(steps) else 0.0
            lossy = any(one.code == "lost_frames" and name in one.radars and one.value > 2 * LOST for one in found)
            if longest > SILENCE and not lossy:
                sentence = f"{name}: silent for {longest:.1f} s"
                radars, subject = ((), name) if name in (SPEED, YAW_RATE) else ((name,), "")
                found.append(Finding("silence", sentence, longest, "s", 0.99, "times between samples or scans", radars, subject))
        pauses = recorded.pauses
        if len(pauses):
            longest = float((pauses[:, 1] - pauses[:, 0]).max())
            sentence = f"recording: it pauses, for {longest:.1f} s at most, in which nobody is heard"
            found.append(Finding("silence", sentence, longest, "s", 0.99, "times between samples or scans", subject=RECORDING))
        return found


def _owners(config: Config, reader: SignalReader) -> tuple[list[Owner], dict[tuple[str, FrameId], tuple[str, int]]]:
    """Who must be heard, and whose frame of what length each id is."""
    owners: list[Owner] = []
    lengths: dict[tuple[str, FrameId], tuple[str, int]] = {}
    for (bus, frame_id), one in reader.readers.items():
        if isinstance(one, MotionReader):
            for name, own in ((SPEED, one.wheel_id), (YAW_RATE, one.yaw_id)):
                if frame_id == own:
                    lengths[bus, frame_id] = name, one.checks[frame_id].length
        elif isinstance(one, PoseReader):
            lengths[bus, frame_id] = POSE, one.checks[frame_id].length
        else:
            lengths[bus, frame_id] = one.sensor, one.roles[frame_id].length
    for one in dict.fromkeys(reader.readers.values()):
        if isinstance(one, MotionReader):
            owners += [Owner(SPEED, config.motion.bus, (one.wheel_id,), False), Owner(YAW_RATE, config.motion.bus, (one.yaw_id,), False)]
        elif isinstance(one, PoseReader):
            owners.append(Owner(POSE, str(config.pose and config.pose.bus), tuple(sorted(one.ids)), False))
        else:
            radar = next(radar for radar in config.radar if radar.name == one.sensor)
            owners.append(Owner(one.sensor, radar.bus, needed(one), more=tuple(one.roles), offset=radar.id_offset))
    return owners, lengths


def needed(radar: RadarReader) -> tuple[FrameId, ...]:
    """The ids without which there is no scan: the header, the first message of detections, the end."""
    kept = [
        frame_id
        for frame_id, role in radar.roles.items()
        if role.kind is FrameKind.HEADER or role.last or (role.kind is FrameKind.DETECTIONS and not role.slot)
    ]
    return tuple(sorted(kept))


def _profiles(config: Config, source: Path) -> tuple[dict[str, RadarProfile], MotionProfile, PoseProfile | None]:
    radars = {radar.name: load_radar(find(radar.profile, source.parent)) for radar in config.radar}
    named = None if config.pose is None else config.pose.profile
    pose = None if named is None else load_pose(find(named, source.parent))
    return radars, load_motion(find(config.motion.profile, source.parent)), pose
