"""All topics out to Zenoh, for our own clients and for ROS. docs/interface.md is the contract."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import zenoh

from echogrid.config import tables as config
from echogrid.config.endpoint import EXAMPLE, nowhere
from echogrid.errors import EchogridError
from echogrid.topics.topic import ALIVE, FLEET, FULL, RUN, TOPICS, Message, Topic
from echogrid.zenoh.access import access_control
from echogrid.zenoh.attachment import GID_SIZE
from echogrid.zenoh.credentials import Credentials, checked
from echogrid.zenoh.fleet import Fleet
from echogrid.zenoh.namesakes import SAID, Namesakes
from echogrid.zenoh.ros import RosNode, every_topic, topic_keys, viewed
from echogrid.zenoh.routers import Routers
from echogrid.zenoh.stream import Stream, is_heard

log = logging.getLogger("echogrid")

# Cells along a window's side from which shared memory is worth what it costs from the first subscriber on: 36 MiB, a thread that looks
# after it 20 times a second, and what Zenoh leaves in /dev/shm. Smaller windows are as fast without.
LARGE = 512
QUIET = 0.2  # s: that nobody listens is not asked for more often, as it costs as much as a look at a bus; what is kept comes at once
VIEWED = ("**", "**/@adv/**")  # `**` passes over chunks that begin with @, where the last map is asked for


def key(vehicle: str, name: str) -> str:
    """The Zenoh key of one of a vehicle's topics, by its name."""
    return f"echogrid/v1/{vehicle}/{name}"


class Publisher:
    """A sink that sends each message under its native key and, if ROS knows the topic, under rmw_zenoh's: a Zenoh session, open from
    construction to `close` or the end of `with`; one thread puts.

    Raises EchogridError naming the key in [publish], the endpoint or file and what to do if Zenoh would not accept it. No call waits for
    a subscriber: one that is too slow misses messages. Others may read the vehicle's keys over this session, but write nothing but poses.
    """

    def __init__(self, settings: config.Publish, vehicle: str, ros: config.Ros, pose: config.Pose | None = None) -> None:
        """`pose`: whose key may be written by its senders, and heard by us."""
        check_pose_key(pose, vehicle, ros)
        self.vehicle = vehicle
        credentials = checked(settings)
        given = [*(key(vehicle, names) for names in VIEWED), *viewed(ros)]
        viewers, senders = (None, None) if settings.tls is None else (settings.tls.viewers, () if pose is None else pose.senders)
        runs = key(vehicle, f"{RUN}/*") if settings.connect else None  # a router of ours may be that of others
        access = access_control(given, viewers, None if pose is None else pose.key, senders, runs)
        if not (settings.listen or settings.connect):
            log.warning("publish: listen and connect are empty, expected an endpoint in one of them: no subscriber can reach this service")
        large = settings.window_cells >= LARGE
        self._open = ExitStack()
        try:
            session = session_config(settings.listen, settings.connect, sends=True, large=large, credentials=credentials, access=access)
            opened = zenoh.open(session)
            self.session = self._open.enter_context(opened)
        except BaseException as error:
            if isinstance(error, zenoh.ZError) or type(error).__name__ == "PanicException":  # which has no module to be imported from
                raise EchogridError(_refused(settings, error)) from error
            raise
        self.gid = hashlib.blake2b(str(self.session.zid()).encode(), digest_size=GID_SIZE).digest()
        native = {
            topic: Stream(self.session, key(vehicle, topic.name), topic, self.gid, versioned=topic.rank > 0) for topic in (*TOPICS, FLEET)
        }
        self._ros = RosNode(self.session, ros)
        self._streams = {topic: [names[topic] for names in (native, self._ros.streams) if topic in names] for topic in TOPICS}
        self._fleet, self._to_fleet = Fleet(settings.fleet_hz), native[FLEET]
        self._quiet_until = 0.0  # by time.monotonic(): it is known that nobody listens
        # They send nothing: two looks say that nobody listens to any topic, where each by itself would be seventeen.
        self._all = [self.session.declare_publisher(keys) for keys in (key(vehicle, "**"), *every_topic(ros))]
        self._alive = self.session.liveliness().declare_token(key(vehicle, ALIVE))
        self._routers = Routers(self.session, settings.connect)
        self._namesakes = Namesakes(self.session, key(vehicle, "")[:-1], self.gid, asks=runs is not None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; subscribers see the liveliness tokens go. A second time does nothing."""
        self._open.close()

    def wants(self, *topics: Topic) -> bool:
        """As of `topics.topic.Sink`; who comes when nobody else is there may be told of QUIET later."""
        now = time.monotonic()
        if now < self._quiet_until:
            return False
        if not any(map(is_heard, self._all)):
            self._quiet_until = now + QUIET
            return False
        return any(stream.heard() for topic in topics for stream in self._streams[topic]) or (FULL in topics and self._to_fleet.heard())

    def reasons(self) -> tuple[str, ...]:
        """What is wrong outside: another service that publishes as our vehicle, an endpoint that is not connected. For one thread."""
        return (*((SAID.format(self.vehicle),) if self._namesakes.others() else ()), *self._routers.missing())

    def put(self, message: Message) -> None:
        """To all subscribers."""
        for stream in self._streams[message.topic]:
            stream.put(message)
        if message.topic is FULL and self._fleet.due(message.stamp_ns) and self._to_fleet.heard():
            self._to_fleet.put(self._fleet.message(message))


def check_pose_key(pose: config.Pose | None, vehicle: str, ros: config.Ros) -> None:
    """Raises EchogridError where `pose.key` is no key expression, or takes in one of ours: who may send poses may not send maps."""
    if pose is None or pose.key is None:
        return
    try:
        asked = zenoh.KeyExpr(pose.key)
    except zenoh.ZError as error:
        expected = "expected a key expression of Zenoh such as ins/odom or 0/ins/odom/**"
        raise EchogridError(f"pose.key: '{pose.key}' found, {expected}") from error
    ours = [*(key(vehicle, names) for names in VIEWED), "@ros2_lv/**"]
    ours += [name for _, name in topic_keys(ros)] if ros.distro != "off" else []
    own = next((name for name in ours if asked.intersects(zenoh.KeyExpr(name))), None)
    if own is not None:
        raise EchogridError(f"pose.key: '{pose.key}' found, which takes in '{own}', expected none of the service's own keys")


def session_config(
    listen: Sequence[str],
    connect: Sequence[str],
    *,
    sends: bool,
    large: bool = False,
    credentials: Credentials | None = None,
    access: Mapping[str, object] | None = None,
) -> zenoh.Config:
    """Zenoh's configuration for exactly these endpoints, retried forever, and no discovery.

    Raises zenoh.ZError if an endpoint is not of the form that Zenoh reads. `sends`: it is the service's; `large`: whose maps go through
    shared memory to this machine. `credentials` for tls/ endpoints; `access`: Zenoh's access_control.
    """
    for endpoint in (*listen, *connect):
        if (problem := nowhere(endpoint)) is not None:
            raise zenoh.ZError(f"it {problem.partition(', expected')[0]}")
    pool = {"enabled": large, "pool_size": 32 << 20, "message_size_threshold": 16 << 10}
    settings: dict[str, object] = {
        # A client's open() fails, or waits forever, without a router; others' returns and keeps trying. A router passes nothing
        # from one peer to another, since peers should find each other by themselves; so the service is not a peer.
        "mode": "router" if sends else "peer",
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
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,  # us: a frozen client delays the next so much
        "transport/shared_memory": {"enabled": large or not sends, "mode": "lazy", "transport_optimization": pool},
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


def _refused(settings: config.Publish, error: BaseException) -> str:
    """One sentence about the endpoint that is to blame: each is tried alone, for Zenoh does not always say which it was."""
    if memory := re.search("POSIX shm segment: (OS error [0-9]+)", str(error)):
        return f"publish: Zenoh gets no shared memory ({memory[1]}), expected a /dev/shm that can be written and has some MiB of room"
    if not isinstance(error, zenoh.ZError):
        return f"publish: Zenoh cannot be started: {error}"
    for name, endpoints in (("listen", settings.listen), ("connect", settings.connect)):
        for endpoint in endpoints:
            alone = [(endpoint,) if name == side else () for side in ("listen", "connect")]
            try:
                with zenoh.open(session_config(*alone, sends=False, credentials=checked(settings))):
                    pass
            except zenoh.ZError as own:
                what = reason(own)
                if "Address already in use" in what:
                    advice = "another program has this port: stop it, choose another, or, if it is a Zenoh router, publish.connect to it"
                    return f"publish.listen: '{endpoint}' cannot be listened on: {advice}"
                return f"publish.{name}: Zenoh refuses '{endpoint}' ({what}), expected an endpoint such as '{EXAMPLE}'"
    return f"publish: Zenoh cannot be started: {reason(error)}"
