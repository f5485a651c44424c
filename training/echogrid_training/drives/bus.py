"""A CAN bus's time: how long frames take, who sends next, and how much traffic one bus takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

BITRATE = 500_000  # bit/s, of arbitration and of classic frames
DATA_BITRATE = 2_000_000  # bit/s, of the payload of CAN FD frames
MAX_LOAD = 0.8  # share of a bus's time


def frame_us(length: int, fd: bool) -> int:
    """µs from the start of a frame with an 11-bit id and `length` payload bytes to the end of the pause behind it.

    A stuff bit is taken for every ten bits: between none and the worst case of one in four.
    """
    if not fd:
        stuffed = 34 + 8 * length  # start, id, control, payload, CRC
        return _us(stuffed * 1.1 + 13, BITRATE)  # delimiters, acknowledge, end, pause
    crc = 17 + 6 if length <= 16 else 21 + 7  # with its fixed stuff bits
    return _us(17 * 1.1 + 13, BITRATE) + _us((5 + 8 * length) * 1.1 + 4 + crc, DATA_BITRATE)


def _us(bits: float, rate: int) -> int:
    return round(bits * 1_000_000 / rate)


@dataclass(frozen=True, slots=True)
class Request:
    """A frame that wants the bus: it ends at `due_us`, or later by a whole number of `step_us`."""

    can_id: int
    duration_us: int
    due_us: int
    step_us: int = 1


def arbitrate(senders: Sequence[Sequence[Request]]) -> list[list[int]]:
    """When each sender's frames end, in µs. A sender sends in order; of those ready at the same time, the lowest id goes first."""
    ends: list[list[int]] = [[] for _ in senders]
    heads = {sender: requests[0] for sender, requests in enumerate(senders) if requests}
    free_us = min((head.due_us - head.duration_us for head in heads.values()), default=0)
    while heads:
        start_us, _, sender = min((_start(head, free_us), head.can_id, sender) for sender, head in heads.items())
        free_us = start_us + heads[sender].duration_us
        ends[sender].append(free_us)
        if len(ends[sender]) < len(senders[sender]):
            heads[sender] = senders[sender][len(ends[sender])]
        else:
            del heads[sender]
    return ends


def _start(request: Request, free_us: int) -> int:
    """The first time from `free_us` on at which the frame may start."""
    wished = request.due_us - request.duration_us
    late = max(0, free_us - wished)
    return wished + -(-late // request.step_us) * request.step_us


def share_out(motion_load: float, radar_loads: Sequence[float]) -> list[int]:
    """The bus number of each radar: all on bus 0 with the motion frames if they fit, else motion alone there and radars from bus 1 on."""
    if motion_load + sum(radar_loads) <= MAX_LOAD:
        return [0] * len(radar_loads)
    buses: list[int] = []
    number, load = 1, 0.0
    for radar_load in radar_loads:
        if buses and load + radar_load > MAX_LOAD:
            number, load = number + 1, 0.0
        load += radar_load
        buses.append(number)
    return buses
