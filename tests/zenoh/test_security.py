"""Who gets at what over Zenoh: nobody from outside by default; with TLS the listed viewers, who may look and not touch."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import trustme
import zenoh
import zenoh.ext
from tests.support import messages
from tests.support.frames import CONFIG
from tests.support.places import ROOT
from tests.support.ports import free_port
from tests.support.waiting import PATIENCE, until

from echogrid.client import Client
from echogrid.config.loading import load_config
from echogrid.config.tables import Pose, Publish, Ros, Tls
from echogrid.core.health import PoseHealth
from echogrid.core.messages import PoseFix
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.topics.grids import Grid, decode_grid, encode_grid
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.topic import ALIVE, FLEET, FULL, KEY, REGION, RUN, STATUS, TILE
from echogrid.zenoh.credentials import Credentials
from echogrid.zenoh.pose_feed import PoseFeed
from echogrid.zenoh.publisher import Publisher, key, session_config
from echogrid.zenoh.ros import topic_keys

LOG_ODDS = np.zeros((4, 4), dtype=np.float32)
FAKE_NS = 666  # stamp of maps that nobody may ever see
MAP = key("car", FULL.name)
ROS_MAP = dict(topic_keys(Ros()))[KEY]
GRIDS = (MAP, key("car", KEY.name), ROS_MAP)
TOKEN = key("car", ALIVE)
FLEET_KEY = key("car", FLEET.name)  # which goes out where somebody listens
WIDE = ("**", "echogrid/**", "echogrid/v1/**", "*/v1/**", key("*", "**"), key("car", "**"), "0/**", "@ros2_lv/**", "@ros2_lv/0/**")
FAKE_TOKENS = (key("car", "alive/fake"), "@ros2_lv/0/fake/0/0/NN/%/%/fake")
Look = Callable[[], set[tuple[str, int]]]  # keys and stamps of what has come


@dataclass(frozen=True)
class Files:
    """What an authority issued, by name of the file."""

    folder: Path

    def of(self, name: str, ca: str = "ca") -> Credentials:
        return Credentials(self.folder / f"{ca}.pem", self.folder / f"{name}.pem", self.folder / f"{name}.key")

    def tls(self, *viewers: str) -> Tls:
        ours = self.of("service")
        return Tls(ca=str(ours.ca), certificate=str(ours.certificate), key=str(ours.key), viewers=viewers)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("tls")
    ca, other = trustme.CA(), trustme.CA()
    for name, authority in (("ca", ca), ("other", other)):
        authority.cert_pem.write_to_path(folder / f"{name}.pem")
    issued = {
        "service": ca.issue_cert("127.0.0.1", common_name="service"),
        "viewer": ca.issue_cert("viewer.test", common_name="viewer"),
        "ins": ca.issue_cert("ins.test", common_name="ins"),
        "stranger": ca.issue_cert("stranger.test", common_name="stranger"),
        "expired": ca.issue_cert("viewer.test", common_name="viewer", not_after=datetime.now(UTC) - timedelta(days=1)),
        "foreign": other.issue_cert("viewer.test", common_name="viewer"),
        "elsewhere": ca.issue_cert("elsewhere.test", common_name="service"),
    }
    for name, certificate in issued.items():
        certificate.private_key_pem.write_to_path(folder / f"{name}.key")
        certificate.cert_chain_pems[0].write_to_path(folder / f"{name}.pem")
    return Files(folder)


def opened(endpoint: str, mode: str, credentials: Credentials | None) -> zenoh.Session:
    config = session_config((), (endpoint,), sends=False, credentials=credentials)
    config.insert_json5("mode", json.dumps(mode))
    return zenoh.open(config)


class Intruder:
    """Asks for everything in every way, and sends what is not true."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.stolen: set[str] = set()  # keys of what came that it had not sent itself
        everything = WIDE
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        self.subscribers = [session.declare_subscriber(name) for name in everything]
        self.subscribers += [session.liveliness().declare_subscriber(name, history=True) for name in everything]
        self.subscribers += [
            zenoh.ext.declare_advanced_subscriber(session, name, zenoh.handlers.DefaultHandler(), history=history) for name in GRIDS
        ]
        fake = encode_grid(Grid(FAKE_NS, "odom", 0.5, (0.0, 0.0), np.zeros((2, 2), np.int8)))
        self.lies = {"secret/x": b"of the intruder", **dict.fromkeys(GRIDS, fake), key("car", STATUS.name): b'{"state": "fake"}'}
        asked = (*GRIDS, key("car", REGION), key("car", f"{TILE}/*/*"))
        asked += ("**", "**/@adv/**", *(f"{name}/@adv/**" for name in GRIDS))
        self.queryables = [session.declare_queryable(name, zenoh.handlers.Callback(self._answer, indirect=False)) for name in asked]
        self.tokens = [session.liveliness().declare_token(name) for name in FAKE_TOKENS]

    def act(self) -> None:
        for name, payload in self.lies.items():
            self.session.put(name, payload)
            self.session.delete(name)
        for subscriber in self.subscribers:
            while (sample := subscriber.try_recv()) is not None:
                self._note(sample)

    def ask(self) -> None:
        """For the map, its cache and who is alive."""
        for name in (MAP, f"{MAP}/@adv/**", key("car", "**/@adv/**"), f"{ROS_MAP}/@adv/**", "**", "**/@adv/**", "@/**", "@/**/@adv/**"):
            self._note_all(self.session.get(name, timeout=0.5, accept_replies=zenoh.ReplyKeyExpr.ANY))
        for name in WIDE:
            self._note_all(self.session.liveliness().get(name, timeout=0.5))

    def _answer(self, query: zenoh.Query) -> None:
        """With a lie, under the key that was asked for or under that of the map."""
        with query, suppress(zenoh.ZError):
            name = str(query.key_expr)
            query.reply(MAP if "*" in name else name, self.lies[MAP])

    def _note_all(self, replies: Iterable[zenoh.Reply]) -> None:
        for reply in replies:
            if reply.ok is not None:
                self._note(reply.ok)

    def _note(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr)
        mine = sample.kind == zenoh.SampleKind.DELETE or bytes(sample.payload) == self.lies.get(name)
        own = name.startswith(f"@/{self.session.zid()}/")  # what Zenoh tells each session of itself
        if not mine and not own and name not in FAKE_TOKENS:
            self.stolen.add(name)


@contextmanager
def ears(endpoint: str) -> Iterator[set[str]]:
    """A program that would answer any question; the keys that others ask it for."""
    heard = set[str]()

    def answer(query: zenoh.Query) -> None:
        with query:
            heard.add(str(query.key_expr))

    with opened(endpoint, "client", None) as session:
        for name in ("**", "**/@adv/**", *GRIDS, *(f"{name}/@adv/**" for name in GRIDS), key("car", REGION)):
            session.declare_queryable(name, zenoh.handlers.Callback(answer, indirect=False), complete=True)
        yield heard


@contextmanager
def watched(publisher: Publisher, endpoint: str, mode: str, credentials: Credentials | None) -> Iterator[Look]:
    """A plain viewer that shall see the publisher's maps; gives the stamps of those that came, each with its key."""
    with opened(endpoint, mode, credentials) as session:
        subscribers, stamps = [session.declare_subscriber(name) for name in GRIDS], set()

        def look() -> set[tuple[str, int]]:
            for subscriber in subscribers:
                while (sample := subscriber.try_recv()) is not None:
                    stamps.add((str(sample.key_expr), stamp_of(sample)))
            return stamps

        until(lambda: look() >= {(name, 1) for name in GRIDS}, lambda: send(publisher, 1))
        yield look


def send(publisher: Publisher, stamp_ns: int) -> None:
    """A map under each of its keys."""
    for number, topic in enumerate((FULL, KEY)):
        publisher.put(messages.grid(stamp_ns, 0, 0, 0.5, LOG_ODDS, topic=topic, keyframe=number))


def exchange(publisher: Publisher, endpoint: str, intruder: Intruder, modes: tuple[str, ...], viewer: Credentials | None) -> set[int]:
    """Thirty maps published while an intruder does what it can; the stamps that viewers of each mode saw."""
    with ExitStack() as stack:
        looks = [stack.enter_context(watched(publisher, endpoint, mode, viewer)) for mode in modes]
        for stamp_ns in range(1000, 1030):
            send(publisher, stamp_ns)
            intruder.act()
            time.sleep(0.01)
        last = {(name, 1029) for name in GRIDS}
        until(lambda: all(look() >= last for look in looks), lambda: send(publisher, 1029))
        intruder.act()
        return {stamp_ns for look in looks for _, stamp_ns in look()}


def test_by_default_nothing_can_be_found_from_outside(port: int) -> None:
    """A program with Zenoh's own defaults, which search by multicast: it finds its like, and not the service."""
    control = key("car", "control")
    with (
        Publisher(Publish(listen=(f"tcp/127.0.0.1:{port}",)), "car", Ros()) as publisher,
        zenoh.open(zenoh.Config()) as session,
        zenoh.open(zenoh.Config()) as careless,
    ):
        intruder = Intruder(session)
        deadline = time.monotonic() + PATIENCE
        for stamp_ns in range(10**6):
            publisher.put(messages.grid(stamp_ns, 0, 0, 0.5, LOG_ODDS))
            careless.put(control, b"here")
            intruder.act()
            if stamp_ns > 100 and control in intruder.stolen:
                break
            if time.monotonic() > deadline:
                pytest.skip("multicast does not work here")
            time.sleep(0.01)
        intruder.ask()
        assert intruder.stolen == {control}


def stamp_of(sample: zenoh.Sample) -> int:
    return decode_grid(bytes(sample.payload)).stamp_ns


def test_a_program_on_this_machine_may_look_and_not_touch(port: int) -> None:
    """Clients are sent what other clients put, if whoever is between them lets it pass."""
    endpoint = f"tcp/127.0.0.1:{port}"
    with Publisher(Publish(listen=(endpoint,)), "car", Ros()) as publisher, opened(endpoint, "client", None) as session:
        intruder = Intruder(session)
        assert FAKE_NS not in exchange(publisher, endpoint, intruder, ("peer", "client"), None)
        until(lambda: intruder.stolen >= {*GRIDS, TOKEN}, intruder.ask)
        with Client(endpoint) as client:
            until(client.alive)


def test_the_lies_would_arrive_if_nobody_forbade_them(port: int) -> None:
    """What the test above is worth: the same intruder at a session without access control."""
    endpoint = f"tcp/127.0.0.1:{port}"
    with (
        zenoh.open(session_config((endpoint,), (), sends=False)),
        opened(endpoint, "client", None) as session,
        opened(endpoint, "client", None) as viewer,
    ):
        intruder, subscriber = Intruder(session), viewer.declare_subscriber(MAP)
        assert stamp_of(until(subscriber.try_recv, intruder.act)) == FAKE_NS


def test_the_listed_viewer_sees_the_last_map_and_the_next(port: int, files: Files) -> None:
    endpoint = f"tls/127.0.0.1:{port}"
    with Publisher(Publish(listen=(endpoint,), tls=files.tls("viewer")), "car", Ros()) as publisher:
        publisher.put(messages.grid(7, 0, 0, 0.5, LOG_ODDS))
        with Client(endpoint, credentials=files.of("viewer")) as client:
            grid = client.grid(PATIENCE)
            assert grid is not None
            assert grid.stamp_ns == 7
            until(client.alive)
            publisher.put(messages.grid(8, 0, 0, 0.5, LOG_ODDS))
            grid = client.grid(PATIENCE)
            assert grid is not None
            assert grid.stamp_ns == 8


@pytest.mark.parametrize("who", ["stranger", "expired", "foreign", "nobody", "plain"])
def test_whoever_is_not_listed_sees_nothing_and_changes_nothing(port: int, files: Files, who: str) -> None:
    """A certificate of the same authority, one of the right name but out of date or from another authority, none, and no TLS at all."""
    endpoint = f"tls/127.0.0.1:{port}"
    with Publisher(Publish(listen=(endpoint,), tls=files.tls("viewer")), "car", Ros()) as publisher:
        config = session_config((), (endpoint if who != "plain" else f"tcp/127.0.0.1:{port}",), sends=False)
        if who == "nobody":
            config.insert_json5("transport/link/tls", json.dumps({"root_ca_certificate": str(files.of("viewer").ca)}))
        elif who != "plain":
            config.insert_json5("transport/link/tls", json.dumps(files.of(who).zenoh()))
        with zenoh.open(config) as session:
            intruder = Intruder(session)
            assert FAKE_NS not in exchange(publisher, endpoint, intruder, ("peer", "client"), files.of("viewer"))
            intruder.ask()
            assert intruder.stolen == set()


def test_the_listed_viewer_may_not_touch_either(port: int, files: Files) -> None:
    """The same intruder, let in: it hears, and what it says still reaches nobody."""
    endpoint = f"tls/127.0.0.1:{port}"
    with (
        Publisher(Publish(listen=(endpoint,), tls=files.tls("viewer", "stranger")), "car", Ros()) as publisher,
        opened(endpoint, "client", files.of("stranger")) as session,
    ):
        intruder = Intruder(session)
        assert FAKE_NS not in exchange(publisher, endpoint, intruder, ("peer", "client"), files.of("viewer"))
        until(lambda: intruder.stolen >= {*GRIDS, TOKEN}, intruder.ask)


@pytest.mark.parametrize("who", ["ins", "viewer"])
def test_with_tls_poses_come_from_their_senders_alone(port: int, files: Files, who: str) -> None:
    """Who may look may not say where the car is; who may say that may neither look nor draw."""
    endpoint, pose = f"tls/127.0.0.1:{port}", Pose(key="ins/odom", senders=("ins",))
    told = encode_odometry(Odometry(7, "world", "ins", SE2(1.0, 2.0, 0.5), 0.0, 0.0))
    with (
        Publisher(Publish(listen=(endpoint,), tls=files.tls("viewer")), "car", Ros(), pose) as publisher,
        opened(endpoint, "client", files.of("ins")) as sender,
        opened(endpoint, "client", files.of(who)) as session,
    ):
        feed, taken = PoseFeed(publisher.session, pose, PoseHealth()), list[PoseFix]()
        seen = session.declare_subscriber(MAP)
        if who == "ins":
            until(lambda: taken.extend(feed.take()) or taken, lambda: sender.put("ins/odom", told))
            assert taken[0] == PoseFix(7, 1.0, 2.0, 7, 0.5)
        else:
            until(seen.try_recv, lambda: send(publisher, 1))
        for _ in range(20):
            session.put("ins/odom" if who == "viewer" else "ins/other", told)
            session.put(MAP, told)
            send(publisher, 2)
            time.sleep(0.02)
        assert (who == "viewer") == (not taken and not list(feed.take()))
        maps = 0
        while (sample := seen.try_recv()) is not None:
            maps += bytes(sample.payload) != told  # its own comes back to it
        assert (who == "ins") == (not maps)


def test_a_program_on_this_machine_may_send_poses_and_nothing_else(port: int) -> None:
    endpoint, pose = f"tcp/127.0.0.1:{port}", Pose(key="ins/**")
    told = encode_odometry(Odometry(7, "world", "ins", SE2(1.0, 2.0, 0.5), 0.0, 0.0))
    with (
        Publisher(Publish(listen=(endpoint,)), "car", Ros(), pose) as publisher,
        opened(endpoint, "client", None) as session,
        opened(endpoint, "client", None) as other,
    ):
        feed, spied = PoseFeed(publisher.session, pose, PoseHealth()), other.declare_subscriber("ins/**")
        assert until(lambda: list(feed.take()), lambda: session.put("ins/front/odom", told))
        intruder = Intruder(session)
        assert FAKE_NS not in exchange(publisher, endpoint, intruder, ("peer", "client"), None)
        assert spied.try_recv() is None  # and they go no further


def test_a_viewer_does_not_fall_for_another_host(port: int, files: Files) -> None:
    """The service's certificate is of the right authority, but for another name."""
    endpoint = f"tls/127.0.0.1:{port}"
    elsewhere = files.of("elsewhere")
    tls = Tls(ca=str(elsewhere.ca), certificate=str(elsewhere.certificate), key=str(elsewhere.key), viewers=("viewer",))
    with (
        Publisher(Publish(listen=(endpoint,), tls=tls), "car", Ros()) as publisher,
        Client(endpoint, credentials=files.of("viewer")) as client,
    ):
        publisher.put(messages.grid(7, 0, 0, 0.5, LOG_ODDS))
        assert client.grid(1.0) is None


def test_files_that_do_not_fit_are_one_sentence(tmp_path: Path, files: Files) -> None:
    garbage, none = tmp_path / "garbage.pem", tmp_path / "none.pem"
    garbage.write_text("-----BEGIN CERTIFICATE-----\nnothing\n-----END CERTIFICATE-----\n")
    ours = files.of("viewer")
    locked = tmp_path / "locked.key"
    locked.write_text("-----BEGIN ENCRYPTED PRIVATE KEY-----\nMIIB\n-----END ENCRYPTED PRIVATE KEY-----\n")
    for wrong, sentence in (
        (replace(ours, ca=none), f"{none}: cannot be read: No such file or directory"),
        (replace(ours, certificate=none), f"{none}: cannot be read: No such file or directory"),
        (replace(ours, key=tmp_path), f"{tmp_path}: cannot be read: Is a directory"),
        (replace(ours, ca=garbage), f"{garbage}: holds no certificate in PEM form"),
        (replace(ours, certificate=garbage), f"{garbage}: holds no certificate in PEM form"),
        (replace(ours, certificate=ours.key), f"{ours.key}: holds no certificate in PEM form"),
        (replace(ours, key=ours.ca), f"{ours.ca}: is not an unencrypted PEM key of the certificate {ours.certificate}"),
        (replace(ours, key=locked), f"{locked}: is not an unencrypted PEM key of the certificate {ours.certificate}"),
        (
            replace(ours, key=files.of("stranger").key),
            f"{files.of('stranger').key}: is not an unencrypted PEM key of the certificate {ours.certificate}",
        ),
        (files.of("expired"), f"{files.of('expired').certificate}: is not accepted by {ours.ca}: certificate has expired"),
        (
            files.of("foreign"),
            f"{files.of('foreign').certificate}: is not accepted by {ours.ca}: unable to get local issuer certificate",
        ),
    ):
        with pytest.raises(EchogridError) as caught:
            wrong.check()
        assert str(caught.value) == sentence
    for name in ("service", "viewer"):
        files.of(name).check()
    files.of("foreign", ca="other").check()


def test_the_service_says_it_before_anything_is_opened(port: int, files: Files) -> None:
    expired = files.of("expired")
    tls = Tls(ca=str(expired.ca), certificate=str(expired.certificate), key=str(expired.key), viewers=("viewer",))
    with pytest.raises(EchogridError, match=rf"^publish\.tls: {expired.certificate}: is not accepted by .*: certificate has expired$"):
        Publisher(Publish(listen=(f"tls/127.0.0.1:{port}",), tls=tls), "car", Ros())
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", port))
    with pytest.raises(EchogridError, match=r"^expired|certificate has expired$"):
        Client(f"tls/127.0.0.1:{port}", credentials=expired)


TLS = '\n[publish.tls]\nca = "ca.pem"\ncertificate = "car.pem"\nkey = "/etc/car.key"\nviewers = ["viewer"]\n'


@pytest.mark.parametrize(
    ("publish", "expected"),
    [
        (
            'listen = ["tcp/0.0.0.0:7447"]',
            "publish.listen: 'tcp/0.0.0.0:7447' leaves this machine unprotected, expected tls/HOST",
        ),
        ('listen = ["tcp/[::]:7447"]', "publish.listen: 'tcp/[::]:7447' leaves this machine unprotected"),
        ('listen = ["tcp/localhost.evil.test:7447"]', "leaves this machine unprotected"),
        ('listen = ["udp/224.0.0.224:7446"]', "leaves this machine unprotected"),
        ('connect = ["tcp/192.0.2.1:7447"]', "publish.connect: 'tcp/192.0.2.1:7447' leaves this machine unprotected"),
        ('connect = ["quic/127.0.0.2.test:7447"]', "publish.connect: 'quic/127.0.0.2.test:7447' leaves this machine"),
        ('listen = ["tls/0.0.0.0:7447"]', "publish.listen: 'tls/0.0.0.0:7447' found, expected [publish.tls] with it"),
        (TLS, "publish.listen: 'tcp/127.0.0.1:7447' found beside [publish.tls], expected tls/HOST:PORT"),
        (
            'listen = ["tls/[::]:7447"]' + TLS + '[pose]\nkey = "ins/odom"\n',
            "pose.senders: is missing, expected the common names in the certificates of those who may send, as [publish.tls] is given",
        ),
        (
            'listen = ["tls/[::]:7447"]\nconnect = ["tcp/127.0.0.1:1"]' + TLS,
            "publish.connect: 'tcp/127.0.0.1:1' found beside [publish.tls]",
        ),
        ('listen = ["tls/[::]:7447"]' + TLS.replace('["viewer"]', "[]"), "publish.tls.viewers: [] found, expected an array of length >= 1"),
        ('listen = ["tls/[::]:7447"]' + TLS.replace('ca = "ca.pem"', ""), "publish.tls: the key 'ca' is missing"),
        ('plaintext = true\nlisten = ["tls/[::]:7447"]' + TLS, "publish.plaintext: found beside [publish.tls], expected one of them"),
        (
            '[metrics]\nlisten = "0.0.0.0:9464"',
            "metrics.listen: '0.0.0.0:9464' leaves this machine unprotected, expected the loopback",
        ),
        ('plaintext = true\n[metrics]\nlisten = "[::]:9464"', "metrics.listen: '[::]:9464' leaves this machine unprotected"),
    ],
)
def test_what_would_expose_the_service_is_refused(tmp_path: Path, publish: str, expected: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(f"{CONFIG}\n[publish]\n{publish}\n")
    with pytest.raises(EchogridError) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    "publish",
    [
        'listen = ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "ws/localhost:1", "unixsock-stream//run/echogrid/zenoh.sock"]',
        'listen = []\nconnect = ["tcp/127.3.2.1:7447"]',
        'plaintext = true\nlisten = ["tcp/0.0.0.0:7447"]\nconnect = ["tcp/192.0.2.1:7447"]',
        'listen = ["tls/0.0.0.0:7447"]\nconnect = ["tls/router.test:7447"]' + TLS,
        '[metrics]\nlisten = "[::1]:9464"',
        '[metrics]\nlisten = "0.0.0.0:9464"\nplaintext = true',
    ],
)
def test_what_is_protected_or_asked_for_is_taken(tmp_path: Path, publish: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(f"{CONFIG}\n[publish]\n{publish}\n")
    tls = load_config(path).publish.tls
    assert tls is None or Credentials.of(tls) == Credentials(tmp_path / "ca.pem", tmp_path / "car.pem", Path("/etc/car.key"))


def test_the_five_minutes_of_the_document_work(tmp_path: Path, port: int) -> None:
    """Its commands make the files that its configuration names, the one to start from has that too, and its viewer sees the map."""
    document = (ROOT / "docs" / "security.md").read_text()
    (commands,) = re.findall(r"```sh\n(.*?)```", document, re.DOTALL)
    (publish,) = re.findall(r"```toml\n(.*?)```", document, re.DOTALL)
    made = tmp_path / "tls"
    made.mkdir()
    subprocess.run(["sh", "-e", "-c", commands], cwd=made, check=True, capture_output=True, timeout=PATIENCE)
    start = (ROOT / "deploy" / "echogrid.toml").read_text()
    assert publish in re.sub("^# ?", "", start[start.index("# [publish]") :], flags=re.MULTILINE)
    path = tmp_path / "echogrid.toml"
    path.write_text(f"{CONFIG}\n{publish}".replace("[::]:7447", f"127.0.0.1:{port}"))
    viewer = Credentials(made / "ca.pem", made / "dashboard.pem", made / "dashboard.key")
    with Publisher(load_config(path).publish, "car", Ros()) as publisher, Client(f"tls/127.0.0.1:{port}", credentials=viewer) as client:
        publisher.put(messages.grid(7, 0, 0, 0.5, LOG_ODDS))
        assert client.grid(PATIENCE) is not None


@pytest.mark.parametrize("mode", ["client", "peer"])
@pytest.mark.parametrize("wide", WIDE)
def test_who_may_look_may_ask_for_anything_and_gets_what_it_may_see(port: int, wide: str, mode: str) -> None:
    """Subscriptions, liveliness queries and liveliness subscriptions: Zenoh drops what is not within the allowed, without a word."""
    endpoint = f"tcp/127.0.0.1:{port}"
    with (
        Publisher(Publish(listen=(endpoint,)), "car", Ros()) as publisher,
        opened(endpoint, mode, None) as session,
        opened(endpoint, "client", None) as neighbour,
    ):
        expression = zenoh.KeyExpr(wide)
        subscriber = session.declare_subscriber(wide)
        alive = session.liveliness().declare_subscriber(wide, history=True)
        expected = {name for name in GRIDS if expression.includes(zenoh.KeyExpr(name))}
        tokens, seen = set[str](), set[str]()

        def look() -> None:
            send(publisher, 1)
            neighbour.put("secret/x", b"of a neighbour")
            neighbour.put(key("other", "odom"), b"of a neighbour")
            neighbour.put(MAP, b"of a neighbour")
            for source, found in ((subscriber, seen), (alive, tokens)):
                while (sample := source.try_recv()) is not None:
                    found.add(str(sample.key_expr))
                    assert bytes(sample.payload) != b"of a neighbour"

        node = (wide.startswith("@ros2_lv") and "@ros2_lv") or (TOKEN if expression.includes(zenoh.KeyExpr(TOKEN)) else "")
        deadline = time.monotonic() + PATIENCE
        while not (seen >= expected and (not node or tokens)) and time.monotonic() < deadline:
            look()
            time.sleep(0.02)
        for _ in range(10):
            look()
            time.sleep(0.01)
        assert seen - {FLEET_KEY} == expected
        asked, deadline = set[str](), time.monotonic() + PATIENCE
        while asked != tokens and time.monotonic() < deadline:  # a busy router may answer later than a query waits
            asked |= {str(reply.ok.key_expr) for reply in session.liveliness().get(wide, timeout=0.5) if reply.ok is not None}
        assert tokens == asked
        if node == TOKEN:
            assert tokens == {TOKEN, key("car", f"{RUN}/{publisher.gid.hex()}")}
        elif node:
            assert len(tokens) == 1 + len(dict(topic_keys(Ros())))
        else:
            assert not tokens


def test_a_query_for_everything_is_answered_by_the_service_alone(port: int) -> None:
    """The cache of the last map, which only keys with @adv reach; a queryable of another viewer is not asked."""
    endpoint = f"tcp/127.0.0.1:{port}"
    with (
        Publisher(Publish(listen=(endpoint,)), "car", Ros()) as publisher,
        opened(endpoint, "client", None) as session,
        ears(endpoint) as heard,
    ):
        send(publisher, 1)
        found: dict[str, int] = {}
        deadline = time.monotonic() + PATIENCE
        while not found.keys() >= set(GRIDS) and time.monotonic() < deadline:
            for reply in session.get("**/@adv/**", timeout=0.5, accept_replies=zenoh.ReplyKeyExpr.ANY):
                if reply.ok is not None:
                    found[str(reply.ok.key_expr)] = stamp_of(reply.ok)
        assert found == dict.fromkeys(GRIDS, 1)
        for name in ("**", *GRIDS, f"{MAP}/@adv/**", f"{key('car', REGION)}?bbox=0,0,1,1"):
            for reply in session.get(name, timeout=0.5):
                assert reply.ok is None or str(reply.ok.key_expr) in (*GRIDS, key("car", REGION))
        assert heard == set()


def test_a_router_between_changes_nothing(port: int) -> None:
    """A router without any rule: who asks it for `**` gets the service's maps; what others say there reaches nobody through us."""
    ours, theirs = f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{free_port()}"
    config = session_config((theirs,), (), sends=True)
    with (
        zenoh.open(config),
        Publisher(Publish(listen=(ours,), connect=(theirs,)), "car", Ros()) as publisher,
        opened(theirs, "client", None) as behind,
        opened(ours, "client", None) as beside,
        ears(theirs) as asked,
    ):
        wide, near = behind.declare_subscriber("**"), beside.declare_subscriber("**")
        intruder = Intruder(behind)
        seen, heard = set[str](), set[str]()
        deadline = time.monotonic() + PATIENCE
        rounds = 0
        while (not seen >= set(GRIDS) or not heard >= set(GRIDS) or rounds < 50) and time.monotonic() < deadline:
            rounds += 1
            send(publisher, 1)
            intruder.act()
            while (sample := wide.try_recv()) is not None:
                seen.add(str(sample.key_expr))
            while (sample := near.try_recv()) is not None:
                heard.add(str(sample.key_expr))
                assert sample.kind == zenoh.SampleKind.PUT
                assert str(sample.key_expr) == FLEET_KEY or stamp_of(sample) == 1
            time.sleep(0.02)
        assert seen >= {*GRIDS, "secret/x"}
        assert heard - {FLEET_KEY} == set(GRIDS)
        for name in ("**", "**/@adv/**", MAP):
            for _ in beside.get(name, timeout=0.5):
                pass
        assert not [name for name in asked if name in ("**", "**/@adv/**", MAP)]
