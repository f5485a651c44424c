"""Wheel speeds and yaw rate as the frames of vehicle_motion.dbc."""

from __future__ import annotations

from collections.abc import Sequence

import can
import fastcrc
import numpy as np
from numpy.typing import NDArray

from echogrid_training.drives.bus import Request, frame_us
from echogrid_training.drives.frames import Raw, Report, frame, load_dbc, quantise, sealed
from echogrid_training.recording import Motion

WHEELS = ("RL", "RR", "FL", "FR")


class MotionWriter:
    """The three messages of vehicle_motion.dbc, always classic frames."""

    def __init__(self, motion: Motion, report: Report) -> None:
        database = load_dbc("vehicle_motion")
        rear = database.get_message_by_name("WheelSpeedsRear")
        front = database.get_message_by_name("WheelSpeedsFront")
        yaw = database.get_message_by_name("YawRate")
        rear_speed = motion.wheel_speed[:, :2].mean(axis=1)
        direction = np.where(rear_speed > 0, 1, np.where(rear_speed < 0, 2, 0))  # 0, unknown, where it stands or shows no direction
        wheels: dict[str, tuple[Raw, NDArray[np.bool_]]] = {}
        for wheel, speed in zip(WHEELS, motion.wheel_speed.T, strict=True):
            message = rear if wheel in ("RL", "RR") else front
            wheels[wheel] = quantise(message.get_signal_by_name(f"WheelSpeed{wheel}"), np.abs(speed))
        yaw_rate = quantise(yaw.get_signal_by_name("YawRate"), motion.yaw_rate)
        report.invalid_motion += sum(int(np.count_nonzero(~fits)) for _, fits in (*wheels.values(), yaw_rate))
        self.messages = (rear, front, yaw)
        self.stamps_ns = (motion.wheel_stamp_ns, motion.wheel_stamp_ns, motion.yaw_stamp_ns)
        self.signals: tuple[list[dict[str, int]], ...] = (
            [_wheels(index, wheels, ("RL", "RR")) | {"DirectionOfTravel": int(way)} for index, way in enumerate(direction)],
            [_wheels(index, wheels, ("FL", "FR")) for index in range(len(direction))],
            [{"YawRate": int(raw), "YawRateValid": int(fits)} for raw, fits in zip(*yaw_rate, strict=True)],
        )

    def requests(self) -> list[list[Request]]:
        """One sender for each message: a frame ends at the time of its sample, or once the bus is free."""
        return [
            [Request(message.frame_id, frame_us(message.length, fd=False), stamp_us) for stamp_us in _whole_us(stamps)]
            for message, stamps in zip(self.messages, self.stamps_ns, strict=True)
        ]

    def frames(self, ends_us: Sequence[Sequence[int]]) -> list[can.Message]:
        """All frames; `ends_us` as `arbitrate` gave them for `requests`."""
        return [
            frame(message.frame_id, sealed(message, values | {"Counter": count % 16}, fastcrc.crc8.sae_j1850), end_us, fd=False)
            for message, signals, ends in zip(self.messages, self.signals, ends_us, strict=True)
            for count, (values, end_us) in enumerate(zip(signals, ends, strict=True))
        ]


def _wheels(index: int, wheels: dict[str, tuple[Raw, NDArray[np.bool_]]], names: tuple[str, str]) -> dict[str, int]:
    raw = {f"WheelSpeed{name}": int(wheels[name][0][index]) for name in names}
    return raw | {f"WheelSpeed{name}Valid": int(wheels[name][1][index]) for name in names}


def _whole_us(stamp_ns: NDArray[np.int64]) -> list[int]:
    return [round(stamp / 1000) for stamp in stamp_ns.tolist()]
