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

from echogrid.config.endpoint import EXAMPLE
from echogrid.errors import EchogridError
from echogrid.topics.diagnostic_array import DiagnosticArray, decode_diagnostics
from echogrid.topics.grids import Grid, decode_grid, decode_update
from echogrid.topics.points import JudgedPoints, Points, decode_judged, decode_points
from echogrid.topics.poses import decode_odometry
from echogrid.topics.topic import (
    ALIVE,
    DETECTIONS,
    DIAGNOSTICS,
    FLEET,
    FULL,
    JUDGED,
    KEY,
    META,
    ODOMETRY,
    REGION,
    RUN,
    STATUS,
    UPDATE,
    Topic,
)
from echogrid.zenoh.attachment import decode_grid_attachment
from echogrid.zenoh.credentials import Credentials
from echogrid.zenoh.fleet import decompress
from echogrid.zenoh.follower import Follower, KeyName, MapName, Window
from echogrid.zenoh.publisher import key, reason, session_config

__all__ = ["Client", "Credentials", "DiagnosticArray", "JudgedPoints", "MapName", "Points", "Pose", "Window", "vehicles"]

OTHERS = 0.5  # s in which further vehicles may show up after the first
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
            raise EchogridError(f"vehicle: '{vehicle}' is not a vehicle's name, expected letters, digits, _ and -")
        self.vehicle = vehicle
        self.endpoint = endpoint
        self.malformed = 0
        self._subscribers: dict[Topic, Subscriber] = {}
        self._follower = Follower()
        self._open = ExitStack()
        self._session = self._open.enter_context(_session(endpoint, credentials))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session. A second time does nothing."""
        self._open.close()

    def grid(self, timeout: float = 1.0) -> Window | None:
        """The map around the car, sent whole. The last one arrives at once, even if it was sent before this client connected."""
        return self._newest(FULL, _window, timeout)

    def follow(self, timeout: float = 1.0) -> Window | None:
        """The same, put together from key frames and updates, which is less traffic. Its origin moves in steps, so that
        the car is not quite in its middle. Only complete windows are returned: what was lost is in the next one, within a second."""
        return self._wait(self._followed_next, timeout)

    def fleet(self, timeout: float = 2.0) -> Window | None:
        """The map around the car for slow links: a probability of 0, 25, 50, 75 or 100 percent, about once a second."""
        return self._newest(FLEET, _packed_window, timeout)

    def region(self, box: tuple[float, float, float, float], epoch: int | None = None, timeout: float = 5.0) -> Window | None:
        """Any part of the map: the cells that x0, y0, x1, y1 (m, odom) touch, of the map that is being made or of an older `epoch`.
        Its stamp is when the newest of its cells was last in view, to the second. None if there is no answer in time; raises
        EchogridError with the service's own sentence if it refuses."""
        parameters = f"bbox={','.join(map(repr, map(float, box)))};fmt=zstd" + ("" if epoch is None else f";epoch={epoch}")
        for reply in self._session.get(f"{key(self.vehicle, REGION)}?{parameters}", timeout=timeout):
            try:
                if reply.ok is not None:
                    return _packed_window(reply.ok)
                refusal = _json(bytes(reply.err.payload)) if reply.err is not None else {}
            except ValueError:  # Zenoh's own message for a time-out is not JSON
                self.malformed += reply.ok is not None
                continue
            raise EchogridError(f"vehicle '{self.vehicle}': {refusal.get('error')}")
        return None

    def odometry(self, timeout: float = 1.0) -> Pose | None:
        """The car's motion."""
        return self._newest(ODOMETRY, _pose, timeout)

    def detections(self, timeout: float = 1.0) -> Points | None:
        """The radars' static detections that the newest update of the map was made of, in base."""
        return self._newest(DETECTIONS, lambda sample: decode_points(bytes(sample.payload)), timeout)

    def judged(self, timeout: float = 1.0) -> JudgedPoints | None:
        """All detections of the trusted radars that the newest update was made of, in base: by which radar, and whether they were used."""
        return self._newest(JUDGED, lambda sample: decode_judged(bytes(sample.payload)), timeout)

    def status(self, timeout: float = 2.0) -> dict[str, Any] | None:
        """The service's state; it is sent about once a second."""
        return self._newest(STATUS, _object, timeout)

    def meta(self, timeout: float = 2.0) -> dict[str, Any] | None:
        """What does not change while the service runs: version, model, grid, radars. Comes at once, and again from another run of it."""
        return self._newest(META, _object, timeout)

    def diagnostics(self, timeout: float = 2.0) -> DiagnosticArray | None:
        """The status as ROS knows it: a level and a message for the service, each radar, each bus and the motion. About once a second."""
        return self._newest(DIAGNOSTICS, lambda sample: decode_diagnostics(bytes(sample.payload)), timeout)

    def alive(self) -> bool:
        """Whether the vehicle's service is running and connected, as far as anyone knows within a second."""
        tokens = self._session.liveliness().get(key(self.vehicle, ALIVE), timeout=1.0)
        return any(reply.ok is not None for reply in tokens)

    def runs(self) -> set[bytes]:
        """The services that publish as this vehicle, by the source that their grids name. Where there are several, one vehicle's name
        stands in two configurations, and what each method returns is now of one and now of the other."""
        tokens = self._session.liveliness().get(f"{key(self.vehicle, RUN)}/*", timeout=1.0)
        names = (str(reply.ok.key_expr).rpartition("/")[2] for reply in tokens if reply.ok is not None)
        return {bytes.fromhex(name) for name in names if re.fullmatch("[0-9a-f]{32}", name)}

    def _newest(self, topic: Topic, decode: Callable[[zenoh.Sample], T], timeout: float) -> T | None:
        return self._wait(lambda: self._next(topic, decode), timeout)

    def _next(self, topic: Topic, decode: Callable[[zenoh.Sample], T]) -> T | None:
        """What came since the last time, if anything did."""
        subscriber = self._subscribers.get(topic)
        if subscriber is None:
            subscriber = self._subscribers[topic] = self._subscribe(topic)
        while (sample := subscriber.try_recv()) is not None:
            try:
                return decode(sample)
            except ValueError:
                self.malformed += 1
        return None

    def _followed_next(self) -> Window | None:
        news = [self._next(topic, take) for topic, take in ((KEY, self._take_key), (UPDATE, self._take_update))]
        try:
            return self._follower.window() if any(news) else None
        except ValueError:
            self.malformed += 1
            return None

    def _take_key(self, sample: zenoh.Sample) -> bool:
        grid, name = decode_grid(bytes(sample.payload)), _key_name(sample)
        self._follower.key(name, grid)
        return True

    def _take_update(self, sample: zenoh.Sample) -> bool:
        update, name = decode_update(bytes(sample.payload)), _key_name(sample)
        self._follower.update(name, update)
        return True

    def _wait(self, look: Callable[[], T | None], timeout: float) -> T | None:
        """What `look` finds, at the latest after `timeout` seconds."""
        deadline = time.monotonic() + timeout
        while (found := look()) is None and (left := deadline - time.monotonic()) > 0:
            time.sleep(min(POLL, left))
        return found

    def _subscribe(self, topic: Topic) -> Subscriber:
        """A subscription that keeps the newest sample only."""
        # Channels, no callbacks: a program that ends without `close` hangs forever on a callback's thread.
        name = key(self.vehicle, topic.name)
        if not topic.kept:
            return self._session.declare_subscriber(name, RingChannel(1))
        # Without recovery: waiting for a map that was missed would hold back the newer ones.
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        return zenoh.ext.declare_advanced_subscriber(self._session, name, RingChannel(1), history=history)


def vehicles(endpoint: str = EXAMPLE, credentials: Credentials | None = None, timeout: float = 5.0) -> list[str]:
    """The vehicles whose services are running and connected at an endpoint, in alphabetical order; none where none is found in time.

    Raises EchogridError as `Client` does.
    """
    deadline = time.monotonic() + timeout
    with _session(endpoint, credentials) as session:
        while not (found := _alive(session)) and (left := deadline - time.monotonic()) > 0:
            time.sleep(min(0.1, left))
        if found:
            time.sleep(OTHERS)
            found |= _alive(session)
    return sorted(found)


def _alive(session: zenoh.Session) -> set[str]:
    """The vehicles of all liveliness tokens."""
    tokens = session.liveliness().get(key("*", ALIVE), timeout=1.0)
    return {str(reply.ok.key_expr).removesuffix(f"/{ALIVE}").rpartition("/")[2] for reply in tokens if reply.ok is not None}


def _session(endpoint: str, credentials: Credentials | None) -> zenoh.Session:
    """A session that connects to an endpoint, now or later. Raises EchogridError."""
    if endpoint.startswith("tls/") and credentials is None:
        raise EchogridError(
            f"endpoint: {endpoint} takes only those who show a certificate, expected three PEM files: the authority's certificate, and a "
            "certificate and its key whose common name is among the service's publish.tls.viewers (status: --tls CA CERTIFICATE KEY)"
        )
    if credentials is not None:
        credentials.check()
    try:
        return zenoh.open(session_config((), (endpoint,), sends=False, credentials=credentials))
    except zenoh.ZError as error:
        what = f"Zenoh refuses '{endpoint}' ({reason(error)}), expected an endpoint such as '{EXAMPLE}'"
        raise EchogridError(f"endpoint: {what}") from error


def _key_name(sample: zenoh.Sample) -> KeyName:
    if sample.attachment is None:
        raise ValueError("a grid without an attachment does not name its map")
    _, _, source, epoch, number = decode_grid_attachment(bytes(sample.attachment))
    return KeyName(MapName(source, epoch), number)


def _window(sample: zenoh.Sample) -> Window:
    return _named(decode_grid(bytes(sample.payload)), sample)


def _packed_window(sample: zenoh.Sample) -> Window:
    return _named(decode_grid(decompress(bytes(sample.payload))), sample)


def _named(grid: Grid, sample: zenoh.Sample) -> Window:
    return Window(grid.stamp_ns, grid.frame, grid.cell, grid.origin, grid.occupancy, _key_name(sample).map)


def _object(sample: zenoh.Sample) -> dict[str, Any]:
    return _json(bytes(sample.payload))


def _pose(sample: zenoh.Sample) -> Pose:
    odometry = decode_odometry(bytes(sample.payload))
    pose = odometry.pose
    return Pose(odometry.stamp_ns, pose.x, pose.y, pose.yaw, odometry.speed, odometry.yaw_rate)


def _json(payload: bytes) -> dict[str, Any]:
    try:
        return msgspec.json.decode(payload, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"not a JSON object: {error}") from error
