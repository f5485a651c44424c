"""Cars of our own making, with DBC files of their own: the same drive as other sensors would send it, encoded by cantools."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import can
import cantools
import numpy as np
from tests.judging.trial import winding
from tests.support import world

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.core.messages import RadarScan, Speed, YawRate


@dataclass(frozen=True, eq=False)
class Car:
    """`dbc`: text. `radar`: the messages of a scan, by name with their signals, of radar number n, cycle c. `motion`: those of ego motion.

    `shifts`, `channels`: of each radar; `motion_channel`: of ego motion. `config`, `profiles`: the right ones, written by hand.
    """

    dbc: str
    radar: Callable[[int, RadarScan, int], list[tuple[str, dict[str, float]]]]
    motion: Callable[[float, float, int], list[tuple[str, dict[str, float]]]]
    shifts: tuple[int, int, int, int]
    channels: tuple[int, int, int, int]
    motion_channel: int
    fd: bool
    profiles: dict[str, str]
    config: str

    @cached_property
    def messages(self) -> list[can.Message]:
        """The drive, channels numbered from 0 as python-can numbers them."""
        database = cantools.database.load_string(self.dbc, "dbc")
        scans, speeds, rates = decoded()
        out = []
        for n, own in enumerate(scans):
            for c, scan in enumerate(own):
                frames = [
                    frame(database, name, values, scan.received_ns * 1e-9 + 2e-4 * k, self.shifts[n], self.channels[n], self.fd)
                    for k, (name, values) in enumerate(self.radar(n, scan, c))
                ]
                out += frames
        rate_at = [rate.stamp_ns * 1e-9 for rate in rates]
        for c, speed in enumerate(speeds):
            at = speed.stamp_ns * 1e-9
            turning = float(np.interp(at, rate_at, [rate.yaw_rate for rate in rates]))
            for k, (name, values) in enumerate(self.motion(speed.speed, turning, c)):
                out.append(frame(database, name, values, at + 5e-4 * k, 0, self.motion_channel, False))
        return sorted(out, key=lambda message: message.timestamp)

    def write(self, folder: Path, name: str) -> tuple[Path, Path, Path]:
        """Log, DBC and the right configuration, which says the channels of candump logs."""
        folder.mkdir(parents=True, exist_ok=True)
        with can.Logger(folder / name) as logger:
            for message in self.messages:
                named = copy(message)
                named.channel = f"can{message.channel}" if name.endswith(".log") else message.channel
                logger.on_message_received(named)
        (folder / "own.dbc").write_text(self.dbc)
        for file, text in self.profiles.items():
            (folder / file).write_text(text)
        (folder / "right.toml").write_text(self.config)
        return folder / name, folder / "own.dbc", folder / "right.toml"


def frame(
    database: cantools.database.Database, name: str, values: dict[str, float], at: float, shift: int, channel: int, fd: bool
) -> can.Message:
    message = database.get_message_by_name(name)
    data = message.encode(values, strict=False, padding=False)
    return can.Message(
        timestamp=round(at, 6),
        arbitration_id=message.frame_id + shift,
        is_extended_id=False,
        data=data,
        channel=channel,
        is_fd=fd and len(data) > 8,
    )


@cache
def decoded() -> tuple[list[list[RadarScan]], list[Speed], list[YawRate]]:
    """The drawn drive as scans of each radar, and ego motion."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        source = winding().write(Path(folder))
        config = load_config(source)
        reader = SignalReader(config, source, Health())
    items = [item for _, items in reader.heard([FrameBatch.of(winding().messages)], config.bus) for item in items]
    scans = [[item for item in items if isinstance(item, RadarScan) and item.sensor == name] for name in world.RADARS]
    return scans, [item for item in items if isinstance(item, Speed)], [item for item in items if isinstance(item, YawRate)]


def dbc(messages: dict[str, tuple[int, int, list[str]]]) -> str:
    """`messages`: id, length and signal lines by name."""
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: Gateway", ""]
    for name, (number, length, signals) in messages.items():
        lines += [f"BO_ {number} {name}: {length} Gateway", *(f" SG_ {signal} Gateway" for signal in signals), ""]
    return "\n".join(lines) + "\n"


def big(bit: int) -> int:
    """A Motorola start bit, from the bit's place counted from the most significant bit of the first byte."""
    return 8 * (bit // 8) + 7 - bit % 8


MOUNTS = "\n".join(
    f'[[radar]]\nname = "{name}"\nbus = "{{bus[{n}]}}"\nprofile = "{{profile[{n}]}}"\nid_offset = {{shift[{n}]}}\nx = {x}\ny = {y}\n'
    f"yaw_deg = {yaw}\nfov_deg = 140.0\n"
    for n, (name, (x, y, yaw)) in enumerate(world.RADARS.items())
)


def config(buses: str, motion: str, bus: list[str], profile: list[str], shift: tuple[int, ...]) -> str:
    return f"{buses}\n[motion]\n{motion}\n" + MOUNTS.format(bus=bus, profile=profile, shift=shift)


# --- one: CAN FD, messages of each radar's own, pages of seven, Motorola, degrees to the right, approaching; km/h, degrees/s to the right


def _falcon_dbc() -> str:
    messages: dict[str, tuple[int, int, list[str]]] = {
        "Brake_WheelSpeeds": (
            0x1A0,
            8,
            [f'WhlSpd_{c} : {16 * n}|16@1+ (0.01,0) [0|655] "km/h"' for n, c in enumerate(("FL", "FR", "RL", "RR"))],
        ),
        "ESP_Inertial": (
            0x1B4,
            8,
            [
                'ESP_YawRate : 7|16@0- (0.01,0) [-327|327] "deg/s"',
                'ESP_LatAccel : 23|16@0- (0.001,0) [-30|30] "m/s^2"',
                'ESP_Alive : 51|4@0+ (1,0) [0|15] ""',
                'ESP_CRC : 63|8@0+ (1,0) [0|255] ""',
            ],
        ),
    }  # fmt: skip
    for n, corner in enumerate(("FL", "FR", "RL", "RR")):
        base = 0x320 + 8 * n
        messages[f"SRR_{corner}_Status"] = (
            base,
            8,
            [
                'ScanNumber : 7|16@0+ (1,0) [0|65535] ""',
                'NumTargets : 23|8@0+ (1,0) [0|255] ""',
                'Temperature : 31|8@0- (1,0) [-40|125] "degC"',
            ],
        )
        signals = ['SegmentIdx : 7|4@0+ (1,0) [0|15] ""', 'ScanNumberLow : 3|4@0+ (1,0) [0|15] ""']
        for k in range(1, 8):
            at = 8 + 64 * (k - 1)
            signals += [
                f'Tgt{k}_Distance : {big(at)}|16@0+ (0.01,0) [0|655] "m"',
                f'Tgt{k}_RelSpeed : {big(at + 16)}|16@0- (0.01,0) [-320|320] "m/s"',
                f'Tgt{k}_Angle : {big(at + 32)}|16@0- (0.01,0) [-320|320] "deg"',
                f'Tgt{k}_RCS : {big(at + 48)}|8@0- (0.5,0) [-64|64] "dBsm"',
                f'Tgt{k}_ExistProb : {big(at + 56)}|8@0+ (0.5,0) [0|100] "%"',
            ]
        messages[f"SRR_{corner}_Targets"] = (base + 1, 64, signals)
    return dbc(messages)


def _falcon_radar(n: int, scan: RadarScan, cycle: int) -> list[tuple[str, dict[str, float]]]:
    corner = ("FL", "FR", "RL", "RR")[n]
    out: list[tuple[str, dict[str, float]]] = [
        (f"SRR_{corner}_Status", {"ScanNumber": (cycle + 1000 * n) % 65536, "NumTargets": len(scan), "Temperature": 31.0})
    ]
    for page in range(-(-len(scan) // 7)):
        values: dict[str, float] = {"SegmentIdx": page, "ScanNumberLow": (cycle + 1000 * n) % 16}
        for k in range(1, 8):
            i = 7 * page + k - 1
            there = i < len(scan)
            values |= {
                f"Tgt{k}_Distance": float(scan.range[i]) if there else 0.0,
                f"Tgt{k}_RelSpeed": -float(scan.range_rate[i]) if there else 0.0,
                f"Tgt{k}_Angle": -math.degrees(scan.azimuth[i]) if there else 0.0,
                f"Tgt{k}_RCS": 5.0,
                f"Tgt{k}_ExistProb": 90.0 if there else 0.0,
            }
        out.append((f"SRR_{corner}_Targets", values))
    return out


def _falcon_motion(speed: float, yaw_rate: float, cycle: int) -> list[tuple[str, dict[str, float]]]:
    wheels = {f"WhlSpd_{c}": abs(speed) * 3.6 for c in ("FL", "FR", "RL", "RR")}
    inertial = {"ESP_YawRate": -math.degrees(yaw_rate), "ESP_LatAccel": 0.0, "ESP_Alive": cycle % 16, "ESP_CRC": 0}
    return [("Brake_WheelSpeeds", wheels), ("ESP_Inertial", inertial)]


def _falcon_profile(corner: str) -> str:
    return f"""kind = "radar"
dbc = "own.dbc"
[header]
message = "SRR_{corner}_Status"
cycle = "ScanNumber"
count = ["NumTargets"]
[detections]
messages = "SRR_{corner}_Targets"
page = "SegmentIdx"
cycle = "ScanNumberLow"
cycle_bits = 4
per_frame = 7
range = {{ signal = "Tgt{{k}}_Distance", unit = "m" }}
azimuth = {{ signal = "Tgt{{k}}_Angle", unit = "deg", sign = -1 }}
range_rate = {{ signal = "Tgt{{k}}_RelSpeed", unit = "m/s", sign = -1 }}
rcs = {{ signal = "Tgt{{k}}_RCS", unit = "dBsm" }}
"""


FALCON = Car(
    _falcon_dbc(),
    _falcon_radar,
    _falcon_motion,
    (0, 0, 0, 0),
    (0, 0, 1, 1),
    0,
    True,
    {f"{corner}.toml": _falcon_profile(corner) for corner in ("FL", "FR", "RL", "RR")}
    | {
        "motion.toml": """kind = "motion"
dbc = "own.dbc"
[wheel_speeds]
message = "Brake_WheelSpeeds"
rear_left = { signal = "WhlSpd_RL", unit = "km/h" }
rear_right = { signal = "WhlSpd_RR", unit = "km/h" }
[yaw_rate]
message = "ESP_Inertial"
yaw_rate = { signal = "ESP_YawRate", unit = "deg/s", sign = -1 }
"""
    },
    config(
        '[[bus]]\nname = "one"\nchannel = "can0"\n[[bus]]\nname = "two"\nchannel = "can1"\n',
        'bus = "one"\nprofile = "motion.toml"',
        ["one", "one", "two", "two"],
        ["FL.toml", "FR.toml", "RL.toml", "RR.toml"],
        (0, 0, 0, 0),
    ),
)


# --- two: classic CAN, an id for each detection, the header last, one radar in the DBC and the others moved; no units but of the speed


def _heron_dbc() -> str:
    messages: dict[str, tuple[int, int, list[str]]] = {
        "CHASSIS_1": (
            0x0C1,
            8,
            [
                'RearLeftWheel_Speed : 0|16@1+ (0.001,0) [0|65] "m/s"',
                'RearRightWheel_Speed : 16|16@1+ (0.001,0) [0|65] "m/s"',
                'GyroZ : 32|16@1- (0.0001,0) [-3|3] "rad/s"',
                'MsgCnt : 48|4@1+ (1,0) [0|15] ""',
            ],
        ),
    }  # fmt: skip
    for n in range(32):
        messages[f"CR_Obj_{n:02d}"] = (
            0x400 + n,
            8,
            [
                f'Obj{n:02d}_R : 0|15@1+ (0.01,0) [0|300] ""',
                f'Obj{n:02d}_Phi : 16|14@1- (0.0005,0) [-3|3] ""',
                f'Obj{n:02d}_Vr : 30|14@1- (0.01,0) [-80|80] ""',
                f'Obj{n:02d}_Valid : 44|1@1+ (1,0) [0|1] ""',
                f'Obj{n:02d}_Cyc : 48|8@1+ (1,0) [0|255] ""',
            ],
        )
    messages["CR_End"] = (0x420, 4, ['Cyc : 0|8@1+ (1,0) [0|255] ""', 'ObjCount : 8|8@1+ (1,0) [0|255] ""'])
    return dbc(messages)


def _heron_radar(n: int, scan: RadarScan, cycle: int) -> list[tuple[str, dict[str, float]]]:
    count = min(len(scan), 32)
    out: list[tuple[str, dict[str, float]]] = []
    for i in range(count):
        values = {"R": scan.range[i], "Phi": scan.azimuth[i], "Vr": scan.range_rate[i], "Valid": 1, "Cyc": cycle % 256}
        out.append((f"CR_Obj_{i:02d}", {f"Obj{i:02d}_{key}": float(value) for key, value in values.items()}))
    return [*out, ("CR_End", {"Cyc": cycle % 256, "ObjCount": count})]


HERON = Car(
    _heron_dbc(),
    _heron_radar,
    lambda speed, yaw_rate, c: [
        ("CHASSIS_1", {"RearLeftWheel_Speed": abs(speed), "RearRightWheel_Speed": abs(speed), "GyroZ": yaw_rate, "MsgCnt": c % 16})
    ],
    (0, 0x40, 0x80, 0xC0),
    (1, 1, 1, 1),
    0,
    False,
    {
        "radar.toml": """kind = "radar"
dbc = "own.dbc"
ends_with = "CR_End"
[header]
message = "CR_End"
cycle = "Cyc"
count = ["ObjCount"]
[detections]
messages = "CR_Obj_{n:02d}"
n = [0, 31]
cycle = "Obj{n:02d}_Cyc"
range = { signal = "Obj{n:02d}_R", unit = "m" }
azimuth = { signal = "Obj{n:02d}_Phi", unit = "rad" }
range_rate = { signal = "Obj{n:02d}_Vr", unit = "m/s" }
valid = { signal = "Obj{n:02d}_Valid", one_of = [1] }
""",
        "motion.toml": """kind = "motion"
dbc = "own.dbc"
[wheel_speeds]
message = "CHASSIS_1"
rear_left = { signal = "RearLeftWheel_Speed", unit = "m/s" }
rear_right = { signal = "RearRightWheel_Speed", unit = "m/s" }
[yaw_rate]
message = "CHASSIS_1"
yaw_rate = { signal = "GyroZ", unit = "rad/s" }
""",
    },
    config(
        '[[bus]]\nname = "body"\nchannel = "can0"\n[[bus]]\nname = "radars"\nchannel = "can1"\n',
        'bus = "body"\nprofile = "motion.toml"',
        ["radars"] * 4,
        ["radar.toml"] * 4,
        (0, 0x40, 0x80, 0xC0),
    ),
)


# --- three: Cartesian clusters under one id, y to the right, a header that counts; wheels in rad/s


STORK = Car(
    dbc(
        {
            "WHEELS": (
                0x210,
                8,
                [f'Wheel_{c}_Omega : {16 * n}|16@1+ (0.01,0) [0|400] "rad/s"' for n, c in enumerate(("LF", "RF", "LR", "RR"))],
            ),
            "DYN": (0x211, 8, ['VehYaw_Rate : 0|16@1- (0.01,0) [-300|300] "deg/s"', 'Cnt : 16|8@1+ (1,0) [0|255] ""']),
            "ClusterList": (0x500, 8, ['MeasCounter : 0|16@1+ (1,0) [0|65535] ""', 'NofClusters : 16|8@1+ (1,0) [0|255] ""']),
            "Cluster": (
                0x501,
                8,
                [
                    'ID : 0|8@1+ (1,0) [0|255] ""',
                    'DistLong : 8|13@1- (0.05,0) [-200|200] "m"',
                    'DistLat : 21|13@1- (0.05,0) [-200|200] "m"',
                    'VrelLong : 34|12@1- (0.05,0) [-100|100] "m/s"',
                    'VrelLat : 46|12@1- (0.05,0) [-100|100] "m/s"',
                ],
            ),
        }
    ),
    lambda n, scan, c: [
        ("ClusterList", {"MeasCounter": c % 65536, "NofClusters": len(scan)}),
        *(
            (
                "Cluster",
                {
                    "ID": i,
                    "DistLong": float(scan.range[i] * np.cos(scan.azimuth[i])),
                    "DistLat": -float(scan.range[i] * np.sin(scan.azimuth[i])),
                    "VrelLong": float(scan.range_rate[i] * np.cos(scan.azimuth[i])),
                    "VrelLat": -float(scan.range_rate[i] * np.sin(scan.azimuth[i])),
                },
            )
            for i in range(len(scan))
        ),
    ],
    lambda speed, yaw_rate, c: [
        ("WHEELS", {f"Wheel_{w}_Omega": abs(speed) / 0.34 for w in ("LF", "RF", "LR", "RR")}),
        ("DYN", {"VehYaw_Rate": math.degrees(yaw_rate), "Cnt": c % 256}),
    ],
    (0, 0x10, 0x20, 0x30),
    (0, 0, 0, 0),
    0,
    False,
    {
        "radar.toml": """kind = "radar"
dbc = "own.dbc"
[header]
message = "ClusterList"
cycle = "MeasCounter"
count = ["NofClusters"]
[detections]
messages = "Cluster"
page = "ID"
x = { signal = "DistLong", unit = "m" }
y = { signal = "DistLat", unit = "m", sign = -1 }
vx = { signal = "VrelLong", unit = "m/s" }
vy = { signal = "VrelLat", unit = "m/s", sign = -1 }
""",
        "motion.toml": """kind = "motion"
dbc = "own.dbc"
[wheel_speeds]
message = "WHEELS"
rear_left = { signal = "Wheel_LR_Omega", unit = "rad/s" }
rear_right = { signal = "Wheel_RR_Omega", unit = "rad/s" }
[yaw_rate]
message = "DYN"
yaw_rate = { signal = "VehYaw_Rate", unit = "deg/s" }
""",
    },
    config(
        '[[bus]]\nname = "only"\nchannel = "can0"\n',
        'bus = "only"\nprofile = "motion.toml"\nwheel_radius = 0.34',
        ["only"] * 4,
        ["radar.toml"] * 4,
        (0, 0x10, 0x20, 0x30),
    ),
)
CARS = {"falcon": FALCON, "heron": HERON, "stork": STORK}
