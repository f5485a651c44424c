"""The tables of the configuration, typed, with defaults that drive. docs/configuration.md describes every key."""

from __future__ import annotations

import math
from typing import Annotated, Literal
from urllib.parse import urlsplit

from msgspec import Meta

from echogrid.config.toml import NAMESPACE, SHA256, WORD, Table
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.tile import tile_bytes
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise

Positive = Annotated[float, Meta(ge=1e-6, le=1e6)]  # wide enough for whatever unit, and nothing overflows
NotNegative = Annotated[float, Meta(ge=0, le=1e6)]
Bitrate = Annotated[int, Meta(ge=1000, le=100_000_000)]  # bit/s
Latency = Annotated[float, Meta(ge=-1000, le=1000)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]  # degrees
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Name = Annotated[str, Meta(pattern=WORD)]  # goes into Zenoh keys
NAMED = ("analytic", "default", "paper")  # models that are not a path
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
    bitrate: Bitrate | None = None
    data_bitrate: Bitrate | None = None
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
    wheel_scale: Annotated[float, Meta(ge=0.01, le=100)] = 1.0  # true speed = wheel_scale * the decoded one
    yaw_rate_bias_deg_s: Annotated[float, Meta(ge=-10, le=10)] = 0.0  # what the sensor shows of no turn, taken off
    latency_ms: Latency = 0.0  # of both, added to the profile's
    learns: Literal["driving", "standing", "never"] = "driving"  # when the errors of wheels and yaw rate are learned


class Pose(Table, frozen=True):
    """Where a pose from outside comes from, over a bus or over Zenoh, and of which point of the car it is, in base."""

    bus: str | None = None
    profile: str | None = None
    dbc: str | None = None
    origin: tuple[Latitude, Longitude] | None = None  # of the map frame, where the profile has latitude and longitude
    key: str | None = None  # Zenoh's key expression of nav_msgs/msg/Odometry
    senders: tuple[str, ...] = ()  # with [publish.tls]: the common names in the certificates of those who may send it
    x: Annotated[float, Meta(ge=-100, le=100)] = 0.0  # m
    y: Annotated[float, Meta(ge=-100, le=100)] = 0.0  # m
    yaw_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    latency_ms: Latency = 0.0  # added to the profile's, or to the age that a message's stamp shows

    def base_from_point(self) -> SE2:
        return SE2(self.x, self.y, math.radians(self.yaw_deg))


class Radar(Table, frozen=True):
    """One radar: its traffic, and its mount in base (x forward and y left of the rear axle's centre, yaw counter-clockwise)."""

    name: Name
    bus: str
    x: float  # m
    y: float  # m
    yaw_deg: Annotated[float, Meta(ge=-360, le=360)]
    profile: str = "corner_radar"
    dbc: str | None = None
    id_offset: Annotated[int, Meta(ge=-0x1FFFFFFF, le=0x1FFFFFFF)] = 0  # added to every id of the DBC
    fov_deg: Annotated[float, Meta(ge=5, le=360)] = 150.0  # the full angle
    max_range: Positive = 25.0  # m
    latency_ms: Latency = 0.0  # added to the profile's, or to the age that the sensor reports

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
    """The service's PEM files, and who may connect: the common names in the viewers' certificates."""

    ca: str
    certificate: str
    key: str
    viewers: Annotated[tuple[str, ...], Meta(min_length=1)]


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
    """Under which names ROS 2 nodes with rmw_zenoh see the topics; "jazzy" covers all distributions since Iron."""

    distro: Literal["jazzy", "humble", "off"] = "jazzy"
    domain: Annotated[int, Meta(ge=0, le=232)] = 0  # ROS_DOMAIN_ID
    namespace: Annotated[str, Meta(pattern=NAMESPACE)] = "/echogrid"


class Metrics(Table, frozen=True):
    """Status for Prometheus; nothing by default. Either needs the extra `metrics`."""

    listen: str | None = None  # address:port
    plaintext: bool = False  # it may leave this machine, without TLS
    file: str | None = None  # for node_exporter's textfile collector

    def address(self) -> tuple[str, int] | None:
        """Host and port of `listen`; None if there is none or it is not of that form."""
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
    pose: Pose | None = None
    vehicle: Name = "car"
    model: str = "default"  # one of NAMED, or the path of an .onnx file
    model_sha256: Annotated[str, Meta(pattern=SHA256)] | None = None  # of the path's file
    model_fallback: bool = False  # the analytic model if the configured one fails its checks
    body: Body = Body()
    grid: Grid = Grid()
    gate: Gate = Gate()
    sensor_model: SensorModel = SensorModel()
    map: Map = Map()
    store: Store = Store()
    publish: Publish = Publish()
    ros: Ros = Ros()
    metrics: Metrics = Metrics()

    @property
    def read_buses(self) -> tuple[Bus, ...]:
        """Those that motion, a radar or a pose is on: no frame of another is needed."""
        named = {self.motion.bus, None if self.pose is None else self.pose.bus, *(radar.bus for radar in self.radar)}
        return tuple(bus for bus in self.bus if bus.name in named)
