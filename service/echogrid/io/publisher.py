"""The map, the car's motion and the service's state out to Zenoh. docs/interface.md is the contract."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import msgspec
import numpy as np
import zenoh
import zenoh.ext
from numpy.typing import NDArray

from echogrid import config
from echogrid.core.odometry import EgoState
from echogrid.core.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.io import cdr
from echogrid.io.access import access_control
from echogrid.io.credentials import Credentials

MAP_FRAME, CAR_FRAME = "odom", "base"
GRID_KEY, ODOMETRY_KEY, STATUS_KEY, DIAGNOSTICS_KEY, ALIVE_KEY = "grid/fused/full", "odom", "status", "diagnostics", "alive/fusion"
VIEWED = ("**", "**/@adv/**")  # `**` passes over chunks that begin with @, where the last map is asked for
EXAMPLE = "tcp/127.0.0.1:7447"

GRID_ENCODING = zenoh.Encoding.APPLICATION_CDR.with_schema("nav_msgs/msg/OccupancyGrid")
ODOMETRY_ENCODING = zenoh.Encoding.APPLICATION_CDR.with_schema("nav_msgs/msg/Odometry")
DIAGNOSTICS_ENCODING = zenoh.Encoding.APPLICATION_CDR.with_schema("diagnostic_msgs/msg/DiagnosticArray")


def key(vehicle: str, name: str) -> str:
    """The Zenoh key of one of a vehicle's topics, such as GRID_KEY."""
    return f"echogrid/v1/{vehicle}/{name}"


def occupancy_percent(log_odds: LogOdds) -> NDArray[np.int8]:
    """nav_msgs/OccupancyGrid's cells of log-odds, same shape: round(100 p), -1 where the log-odds are 0: never seen."""
    # 1 / (1 + exp(-l)) = 1/2 + tanh(l/2) / 2, which takes half the time and can not overflow.
    percent: NDArray[np.int8] = np.rint(50 + 50 * np.tanh(log_odds / 2)).astype(np.int8)
    percent[log_odds == 0] = -1
    return percent


class Publisher:
    """A Zenoh session, open from construction to `close` or the end of `with`; one thread publishes.

    Raises EchogridError naming the key in [publish], the endpoint or file and what to do where Zenoh would not take one. No call waits for
    a subscriber: one that is too slow misses messages. Others may read the vehicle's keys over this session, and write nothing.
    """

    def __init__(self, settings: config.Publish, vehicle: str) -> None:
        credentials = _credentials(settings)
        access = access_control([key(vehicle, names) for names in VIEWED], None if settings.tls is None else settings.tls.viewers)
        self._open = ExitStack()
        try:
            opened = zenoh.open(session_config(settings.listen, settings.connect, sends=True, credentials=credentials, access=access))
            session = self._open.enter_context(opened)
        except zenoh.ZError as error:
            raise EchogridError(_refused(settings, error)) from error
        self._grid = _Stamped(
            # A cache of one and `publisher_detection` bring the last map to whoever comes later, also to ROS nodes.
            zenoh.ext.declare_advanced_publisher(
                session,
                key(vehicle, GRID_KEY),
                encoding=GRID_ENCODING,
                # DROP loses large messages whenever a fragment waits, BLOCK stops us for seconds behind one frozen subscriber.
                congestion_control=zenoh.CongestionControl.BLOCK_FIRST,
                reliability=zenoh.Reliability.RELIABLE,
                cache=zenoh.ext.CacheConfig(1),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
                publisher_detection=True,
            ),
            session,
        )
        self._odometry = _Stamped(
            session.declare_publisher(
                key(vehicle, ODOMETRY_KEY),
                encoding=ODOMETRY_ENCODING,
                priority=zenoh.Priority.DATA_HIGH,  # not behind a map's fragments
                reliability=zenoh.Reliability.RELIABLE,
            ),
            session,
        )
        self._status = session.declare_publisher(
            key(vehicle, STATUS_KEY), encoding=zenoh.Encoding.APPLICATION_JSON, priority=zenoh.Priority.DATA_HIGH
        )
        self._diagnostics = _Stamped(
            session.declare_publisher(
                key(vehicle, DIAGNOSTICS_KEY),
                encoding=DIAGNOSTICS_ENCODING,
                priority=zenoh.Priority.DATA_HIGH,
                reliability=zenoh.Reliability.RELIABLE,
            ),
            session,
        )
        self._alive = session.liveliness().declare_token(key(vehicle, ALIVE_KEY))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; subscribers see the liveliness token go. A second time does nothing."""
        self._open.close()

    def grid(self, stamp_ns: int, row: int, column: int, cell: float, log_odds: LogOdds) -> None:
        """A window of the map as measured at `stamp_ns`: cells of `cell` m, (H, W) log-odds, the first cell's row (y) and column (x)."""
        grid = cdr.Grid(stamp_ns, MAP_FRAME, cell, (column * cell, row * cell), occupancy_percent(log_odds))
        self._grid.put(cdr.encode_grid(grid), stamp_ns)

    def odometry(self, ego: EgoState) -> None:
        """Where the car is and how it moves."""
        odometry = cdr.Odometry(ego.stamp_ns, MAP_FRAME, CAR_FRAME, ego.odom_from_base, ego.speed, ego.yaw_rate)
        self._odometry.put(cdr.encode_odometry(odometry), ego.stamp_ns)

    def status(self, status: Mapping[str, object]) -> None:
        """Anything that JSON can hold, dataclasses too, under names."""
        self._status.put(msgspec.json.encode(status))

    def diagnostics(self, diagnostics: cdr.DiagnosticArray) -> None:
        """How the parts fare, for ROS."""
        self._diagnostics.put(cdr.encode_diagnostics(diagnostics), diagnostics.stamp_ns)


class _Stamped:
    """A key whose samples carry rmw_zenoh's attachment; remembers how many it sent."""

    def __init__(self, publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher, session: zenoh.Session) -> None:
        self.publisher = publisher
        who = f"{session.zid()}/{publisher.key_expr}"
        self.gid = hashlib.blake2b(who.encode(), digest_size=cdr.GID_SIZE).digest()
        self.sequence = 0

    def put(self, payload: bytes, stamp_ns: int) -> None:
        self.sequence += 1
        self.publisher.put(payload, attachment=cdr.encode_attachment(self.sequence, stamp_ns, self.gid))


def session_config(
    listen: Sequence[str],
    connect: Sequence[str],
    *,
    sends: bool,
    credentials: Credentials | None = None,
    access: Mapping[str, object] | None = None,
) -> zenoh.Config:
    """Zenoh's configuration for exactly these endpoints, retried for ever, and nothing found by itself.

    Raises zenoh.ZError where an endpoint is not of the form that Zenoh reads. `sends`: keep shared memory ready for large messages.
    `credentials` for tls/ endpoints; `access`: Zenoh's access_control.
    """
    pool = {"enabled": sends, "pool_size": 32 << 20, "message_size_threshold": 16 << 10}
    settings: dict[str, object] = {
        # A client's open() fails, or waits for ever, while nobody is there; a peer's returns and goes on trying.
        "mode": "peer",
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {
            "endpoints": connect,
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 250, "period_max_ms": 2000, "period_increase_factor": 2},
        },
        # Zenoh's own defaults listen on every address and look for others by multicast.
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "timestamping": {"enabled": True},  # without, an AdvancedPublisher may have no cache
        "transport/unicast/max_sessions": 32,
        "transport/shared_memory": {"enabled": True, "mode": "init", "transport_optimization": pool},
    }
    if credentials is not None:
        settings["transport/link/tls"] = credentials.zenoh()
    if access is not None:
        settings["access_control"] = access
    result = zenoh.Config()
    for path, value in settings.items():
        result.insert_json5(path, json.dumps(value))
    return result


def reason(error: zenoh.ZError) -> str:
    """What Zenoh says, without where in its source it says so."""
    text = re.sub(r" at /\S+\.rs:\d+\.?", "", str(error)).strip().rstrip(".!")
    inner = re.search(r'msg: "(.*?)"', text)
    return inner[1] if inner else text


def _credentials(settings: config.Publish) -> Credentials | None:
    """Those of [publish.tls], checked. Raises EchogridError."""
    if settings.tls is None:
        return None
    credentials = settings.tls.credentials()
    try:
        credentials.check()
    except EchogridError as error:
        raise EchogridError(f"publish.tls: {error}") from error
    return credentials


def _refused(settings: config.Publish, error: zenoh.ZError) -> str:
    """One sentence about the endpoint that is to blame: each is tried alone, for Zenoh does not always say which it was."""
    for name, endpoints in (("listen", settings.listen), ("connect", settings.connect)):
        for endpoint in endpoints:
            alone = [(endpoint,) if name == side else () for side in ("listen", "connect")]
            try:
                with zenoh.open(session_config(*alone, sends=False, credentials=_credentials(settings))):
                    pass
            except zenoh.ZError as own:
                what = reason(own)
                if "Address already in use" in what:
                    advice = "another program has this port: stop that one, or choose another"
                    return f"publish.listen: '{endpoint}' cannot be listened on: {advice}"
                return f"publish.{name}: Zenoh refuses '{endpoint}' ({what}), expected an endpoint such as '{EXAMPLE}'"
    return f"publish: Zenoh cannot be started: {reason(error)}"
