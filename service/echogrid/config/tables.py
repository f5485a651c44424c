"""The service's configuration: one TOML file, typed, with defaults that drive. docs/configuration.md describes every key."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

import msgspec
from msgspec import Meta

from echogrid.config.toml import Table, load
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import MOST_RADARS, most_tiles_along, tile_bytes
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise
from echogrid.errors import EchogridError
from echogrid.zenoh.credentials import Credentials

Positive = Annotated[float, Meta(ge=1e-6, le=1e6)]  # wide enough for whatever unit, and nothing overflows
NotNegative = Annotated[float, Meta(ge=0, le=1e6)]
Name = Annotated[str, Meta(pattern="^[A-Za-z0-9_-]+$")]  # goes into Zenoh keys
BUMPER = 0.2  # m: how far outside the outline a radar may sit, behind a bumper
NAMED = ("analytic", "default", "paper")  # models that are no path
NOISE, BEAM = GateNoise(), BeamModel()


class Body(Table, frozen=True):
    """The car's outline in base: the rear-axle centre is `rear_overhang` before its rear end."""

    length: Positive = 4.9
    width: Positive = 1.9
    rear_overhang: Positive = 1.0


class Bus(Table, frozen=True):
    """One CAN bus: python-can's interface and channel. In a log, frames of `log_channel` (default: `channel`) belong to it."""

    name: Name
    interface: str = "socketcan"
    channel: str = "can0"
    fd: bool = True
    bitrate: int | None = None
    data_bitrate: int | None = None
    receive_buffer_kib: Annotated[int, Meta(ge=4, le=65536)] = (
        200  # of the kernel, SocketCAN only; net.core.rmem_max is 208 KiB unless raised
    )
    log_channel: str | int | None = None

    @property
    def logged_as(self) -> str | int:
        """What a recording calls its channel."""
        return self.channel if self.log_channel is None else self.log_channel


class Motion(Table, frozen=True):
    """Where ego motion comes from; `wheel_radius` (m) only for profiles whose wheel speeds are turn rates."""

    bus: str
    profile: str = "vehicle_motion"
    dbc: str | None = None
    wheel_radius: Positive | None = None


class Radar(Table, frozen=True):
    """One radar: its traffic, and its mount in base (x forward and y left of the rear axle's centre, yaw counter-clockwise)."""

    name: Name
    bus: str
    x: float  # m
    y: float  # m
    yaw_deg: float
    profile: str = "corner_radar"
    dbc: str | None = None
    id_offset: Annotated[int, Meta(ge=-0x1FFFFFFF, le=0x1FFFFFFF)] = 0  # added to every id of the DBC
    fov_deg: Annotated[float, Meta(gt=0, le=360)] = 150.0  # the full angle
    max_range: Positive = 25.0  # m

    def mount(self) -> Mount:
        """`base_from_sensor` and the field of view."""
        return Mount(SE2(self.x, self.y, math.radians(self.yaw_deg)), math.radians(self.fov_deg) / 2, self.max_range)


class Grid(Table, frozen=True):
    cells: Annotated[int, Meta(ge=16, le=1024)] = 128
    cell: Positive = 30.0 / 128  # m

    def spec(self) -> GridSpec:
        return GridSpec(self.cells, self.cell)


class Gate(Table, frozen=True):
    """One-sigma errors, how many sigmas of range-rate residual still count as static, and how far a mover reaches."""

    range_rate: Positive = NOISE.range_rate  # m/s
    azimuth_deg: Positive = math.degrees(NOISE.azimuth)
    speed: NotNegative = NOISE.speed  # of the speed
    yaw_rate_deg_s: NotNegative = math.degrees(NOISE.yaw_rate)
    sigmas: Positive = NOISE.sigmas
    mover_radius: NotNegative = NOISE.mover_radius  # m

    def noise(self) -> GateNoise:
        return GateNoise(
            self.range_rate, math.radians(self.azimuth_deg), self.speed, math.radians(self.yaw_rate_deg_s), self.sigmas, self.mover_radius
        )


class SensorModel(Table, frozen=True):
    """The analytic inverse sensor model's log-odds for one detection."""

    occupied: Positive = BEAM.occupied
    free: Annotated[float, Meta(ge=-1e6, le=0)] = BEAM.free
    beam_sigma_deg: Positive = math.degrees(BEAM.beam_sigma)

    def beam(self) -> BeamModel:
        return BeamModel(self.occupied, self.free, math.radians(self.beam_sigma_deg))


class Map(Table, frozen=True):
    cycle_ms: Positive = 50.0
    max_age_ms: Positive = 200.0  # older scans are late
    fusion: Literal["sum", "looks"] | None = None  # None: as the model's file says; the analytic model knows only "sum"
    clamp: Positive = 3.5
    max_tiles: Annotated[int, Meta(ge=16)] = 1024  # in memory
    max_mib: Annotated[int, Meta(ge=8)] = 256  # of them

    def tiles(self, layers: int) -> int:
        """Of so many layers that are kept in memory: the smaller bound wins."""
        return min(self.max_tiles, (self.max_mib << 20) // tile_bytes(layers))


class Store(Table, frozen=True):
    """The map on disk."""

    path: str | None = None  # None: map.egmap in systemd's StateDirectory, where there is one
    flush_s: Annotated[float, Meta(ge=0.1, le=3600)] = 5.0
    max_mib: Annotated[int, Meta(ge=16)] = 1024


class Tls(Table, frozen=True):
    """The service's PEM files, and whom it lets in: the common names in the certificates of those who may see."""

    ca: str
    certificate: str
    key: str
    viewers: Annotated[tuple[str, ...], Meta(min_length=1)]

    def credentials(self) -> Credentials:
        return Credentials(Path(self.ca), Path(self.certificate), Path(self.key))


class Publish(Table, frozen=True):
    """Zenoh. By default on this machine's loopback alone, without scouting."""

    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[str, ...] = ()
    tls: Tls | None = None
    plaintext: bool = False  # endpoints may leave this machine without TLS
    window_cells: Annotated[int, Meta(ge=16, le=4096)] = 256
    rate_hz: Positive = 10.0
    fleet_hz: NotNegative = 1.0  # of the stream for slow links; 0: none


class Ros(Table, frozen=True):
    """Under which names ROS 2 nodes with rmw_zenoh see the topics; "jazzy" stands for all distributions since Iron."""

    distro: Literal["jazzy", "humble", "off"] = "jazzy"
    domain: Annotated[int, Meta(ge=0, le=232)] = 0  # ROS_DOMAIN_ID
    namespace: Annotated[str, Meta(pattern="^(/|(/[A-Za-z_][A-Za-z0-9_]*)+)$")] = "/echogrid"


class Metrics(Table, frozen=True):
    """Status for Prometheus; nothing by default. Either needs the extra `metrics`."""

    listen: str | None = None  # address:port
    plaintext: bool = False  # it may leave this machine, without TLS
    file: str | None = None  # for node_exporter's textfile collector

    def address(self) -> tuple[str, int] | None:
        """Host and port of `listen`; None where there is none or it is not of that form."""
        try:
            parts = urlsplit(f"//{self.listen}")
            host, port = parts.hostname, parts.port
        except ValueError:  # no number, beyond 65535, a bracket that stays open
            return None
        return (host, port) if host and port and parts.netloc == self.listen and "@" not in self.listen else None


class Config(Table, frozen=True):
    bus: tuple[Bus, ...]
    motion: Motion
    radar: tuple[Radar, ...] = ()
    vehicle: Name = "car"
    model: str = "default"  # one of NAMED, or the path of an .onnx file
    model_sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")] | None = None  # of the path's file
    model_fallback: bool = False  # the analytic model where the configured one is not sound
    body: Body = Body()
    grid: Grid = Grid()
    gate: Gate = Gate()
    sensor_model: SensorModel = SensorModel()
    map: Map = Map()
    store: Store = Store()
    publish: Publish = Publish()
    ros: Ros = Ros()
    metrics: Metrics = Metrics()


def load_config(path: Path, model: str | None = None) -> Config:
    """Reads and checks a configuration file; `model` stands in for its own, from the working folder.

    Raises EchogridError with one sentence that names the file and the key.
    """
    config = load(path, Config)
    if model is not None:
        path_or_name = str(Path(model).resolve()) if model.endswith(".onnx") else model
        config = msgspec.structs.replace(config, model=path_or_name, model_sha256=None)
    if config.publish.tls is not None:
        files = {name: str(path.parent / getattr(config.publish.tls, name)) for name in ("ca", "certificate", "key")}
        tls = msgspec.structs.replace(config.publish.tls, **files)
        config = msgspec.structs.replace(config, publish=msgspec.structs.replace(config.publish, tls=tls))
    if config.store.path is not None:
        store = msgspec.structs.replace(config.store, path=str(path.parent / config.store.path))
        config = msgspec.structs.replace(config, store=store)
    problem = next(_problems(config), None)
    if problem is not None:
        raise EchogridError(f"{path}: {problem}")
    return config


def _problems(config: Config) -> Iterator[str]:
    """What the types cannot say, one sentence each."""
    buses = [bus.name for bus in config.bus]
    for key, names in (("bus", buses), ("radar", [radar.name for radar in config.radar])):
        if not names:
            yield f"{key}: none is configured, expected at least one [[{key}]]"
        for index, name in enumerate(names):
            if name in names[:index]:
                yield f"{key}[{index}].name: '{name}' is taken already"
    if len(config.radar) > MOST_RADARS:
        yield f"radar: {len(config.radar)} are configured, expected at most {MOST_RADARS}: the map keeps a bit for each"
    known = ", ".join(buses)
    if config.motion.bus not in buses:
        yield f"motion.bus: no [[bus]] is named '{config.motion.bus}', found {known}"
    if config.model not in NAMED and not config.model.endswith(".onnx"):
        yield f"model: '{config.model}' found, expected {', '.join(NAMED)}, or the path of an .onnx file"
    if config.model in NAMED and config.model_sha256 is not None:
        yield f"model_sha256: given for '{config.model}', expected beside the path of an .onnx file: shipped files are checked anyway"
    if config.model == "analytic" and config.map.fusion == "looks":
        yield "map.fusion: 'looks' found, expected 'sum' for the analytic model: its answers are independent, a network's are not"
    summed = config.model == "analytic" or config.map.fusion == "sum"
    layers = OccupancyMap.layers if summed else LookMap.layers
    room, window = config.map.tiles(layers), most_tiles_along(config.publish.window_cells) ** 2
    if window > room:
        cells = config.publish.window_cells
        yield f"publish.window_cells: {cells} found, whose {window} tiles have no room in map.max_tiles and map.max_mib, which hold {room}"
    if config.metrics.listen is not None and config.metrics.address() is None:
        yield f"metrics.listen: '{config.metrics.listen}' found, expected an address and a port such as '127.0.0.1:9464'"
    elif config.metrics.listen is not None and not config.metrics.plaintext and not _stays_here(f"tcp/{config.metrics.listen}"):
        yield f"metrics.listen: '{config.metrics.listen}' leads out of this machine unprotected, expected the loopback, or plaintext = true"
    file = config.metrics.file
    if file is not None and not (file.startswith("/") and file.endswith(".prom")):
        yield f"metrics.file: '{file}' found, expected an absolute path that ends in .prom, as node_exporter reads no other"
    body = config.body
    for index, radar in enumerate(config.radar):
        if radar.bus not in buses:
            yield f"radar[{index}].bus: no [[bus]] is named '{radar.bus}', found {known}"
        rear, front, side = -body.rear_overhang, body.length - body.rear_overhang, body.width / 2
        if not rear - BUMPER <= radar.x <= front + BUMPER or abs(radar.y) > side + BUMPER:
            yield (
                f"radar[{index}]: '{radar.name}' is mounted at x = {radar.x:g}, y = {radar.y:g} m, outside the car, "
                f"which reaches from x = {rear:g} to {front:g} and y = {-side:g} to {side:g} m in base (see [body])"
            )
    if config.publish.tls is not None and config.publish.plaintext:
        yield "publish.plaintext: found beside [publish.tls], expected one of them"
    for key, endpoints in (("listen", config.publish.listen), ("connect", config.publish.connect)):
        for endpoint in endpoints:
            problem = _exposed(endpoint, config.publish)
            if problem is not None:
                yield f"publish.{key}: '{endpoint}' {problem}"


def _exposed(endpoint: str, publish: Publish) -> str | None:
    """What is wrong with an endpoint's protection, or None."""
    if publish.tls is not None:
        return None if endpoint.startswith("tls/") else "found beside [publish.tls], expected tls/HOST:PORT: others bring no certificate"
    if endpoint.startswith("tls/"):
        return "found, expected [publish.tls] with it"
    if publish.plaintext or _stays_here(endpoint):
        return None
    return "leads out of this machine unprotected, expected tls/HOST:PORT and [publish.tls], or plaintext = true on a trusted network"


def _stays_here(endpoint: str) -> bool:
    protocol, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0].strip("[]")
    try:
        return protocol == "unixsock-stream" or host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, or nothing that Zenoh knows
        return False
