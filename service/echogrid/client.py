"""What echogrid publishes, as numpy arrays and numbers in another Python program. docs/interface.md has an example."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec
import zenoh
import zenoh.ext
from zenoh.handlers import RingChannel

from echogrid.errors import EchogridError
from echogrid.io import cdr
from echogrid.io.cdr import DiagnosticArray, Grid
from echogrid.io.credentials import Credentials
from echogrid.io.publisher import ALIVE_KEY, DIAGNOSTICS_KEY, EXAMPLE, GRID_KEY, ODOMETRY_KEY, STATUS_KEY, key, reason, session_config

__all__ = ["Client", "Credentials", "DiagnosticArray", "Grid", "Pose"]

POLL = 0.005  # s: a channel waits without a time-out, so it is looked at; 200 looks a second cost about 1 % of a core

T = TypeVar("T")
Subscriber = zenoh.Subscriber[zenoh.Handler[zenoh.Sample]] | zenoh.ext.AdvancedSubscriber[zenoh.Handler[zenoh.Sample]]


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the car is in `odom`, and how it moves."""

    stamp_ns: int  # when it was measured
    x: float  # m, of the rear axle's centre
    y: float  # m
    yaw: float  # rad, counter-clockwise, within (-pi, pi]
    speed: float  # m/s, forward
    yaw_rate: float  # rad/s


class Client:
    """Listens to one vehicle. Opens whether or not the service is there, and finds it again when it comes back.

    Raises EchogridError for an endpoint or a vehicle's name that cannot be, and for `credentials` (a tls/ endpoint wants some) that do not
    fit each other. Each reading method returns what is newest and was not returned before, waits up to `timeout` seconds for it, and
    returns None where nothing came; the first call of each subscribes. Payloads that cannot be decoded are skipped and counted in
    `malformed`. One thread at a time may call the same method.
    """

    def __init__(self, endpoint: str = EXAMPLE, vehicle: str = "car", credentials: Credentials | None = None) -> None:
        if not re.fullmatch("[A-Za-z0-9_-]+", vehicle):
            raise EchogridError(f"vehicle: '{vehicle}' is no vehicle's name, expected letters, digits, _ and -")
        self.vehicle = vehicle
        self.endpoint = endpoint
        self.malformed = 0
        self._subscribers: dict[str, Subscriber] = {}
        if credentials is not None:
            credentials.check()
        self._open = ExitStack()
        try:
            self._session = self._open.enter_context(zenoh.open(session_config((), (endpoint,), sends=False, credentials=credentials)))
        except zenoh.ZError as error:
            what = f"Zenoh refuses '{endpoint}' ({reason(error)}), expected an endpoint such as '{EXAMPLE}'"
            raise EchogridError(f"endpoint: {what}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session. A second time does nothing."""
        self._open.close()

    def grid(self, timeout: float = 1.0) -> Grid | None:
        """The map around the car. The last one there was comes at once, also where it was sent before this client came."""
        return self._newest(GRID_KEY, cdr.decode_grid, timeout)

    def odometry(self, timeout: float = 1.0) -> Pose | None:
        """The car's motion."""
        return self._newest(ODOMETRY_KEY, _pose, timeout)

    def status(self, timeout: float = 2.0) -> dict[str, Any] | None:
        """The service's state; it is sent about once a second."""
        return self._newest(STATUS_KEY, _json, timeout)

    def diagnostics(self, timeout: float = 2.0) -> DiagnosticArray | None:
        """The status as ROS knows it: a level and a message for the service, each radar, each bus and the motion. About once a second."""
        return self._newest(DIAGNOSTICS_KEY, cdr.decode_diagnostics, timeout)

    def alive(self) -> bool:
        """Whether the vehicle's service is running and connected, as far as anyone knows within a second."""
        tokens = self._session.liveliness().get(key(self.vehicle, ALIVE_KEY), timeout=1.0)
        return any(reply.ok is not None for reply in tokens)

    def _newest(self, name: str, decode: Callable[[bytes], T], timeout: float) -> T | None:
        deadline = time.monotonic() + timeout
        subscriber = self._subscribers.get(name)
        if subscriber is None:
            subscriber = self._subscribers[name] = self._subscribe(name)
        while True:
            sample = subscriber.try_recv()
            if sample is not None:
                try:
                    return decode(bytes(sample.payload))
                except ValueError:
                    self.malformed += 1
            left = deadline - time.monotonic()
            if left <= 0:
                return None
            time.sleep(min(POLL, left))

    def _subscribe(self, name: str) -> Subscriber:
        """A subscription that keeps the newest sample only."""
        # Channels, no callbacks: a program that ends without `close` hangs for ever on a callback's thread.
        if name != GRID_KEY:
            return self._session.declare_subscriber(key(self.vehicle, name), RingChannel(1))
        # Without recovery: waiting for a map that was missed would hold back the newer ones.
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        return zenoh.ext.declare_advanced_subscriber(self._session, key(self.vehicle, name), RingChannel(1), history=history)


def _pose(payload: bytes) -> Pose:
    odometry = cdr.decode_odometry(payload)
    pose = odometry.pose
    return Pose(odometry.stamp_ns, pose.x, pose.y, pose.yaw, odometry.speed, odometry.yaw_rate)


def _json(payload: bytes) -> dict[str, Any]:
    try:
        return msgspec.json.decode(payload, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"the status is no JSON object: {error}") from error
