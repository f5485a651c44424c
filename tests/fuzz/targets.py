"""What takes bytes that others wrote. A target returns or fails: whatever an input may do rightly, it has caught.

Each is a function of the input's bytes, which it puts where the service finds such: into a file in a folder of its own, or on a bus.
"""

from __future__ import annotations

import functools
import struct
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import numpy as np

from echogrid.can import radar, signals
from echogrid.can.dbc import Dbc
from echogrid.can.intake.frames import FrameBatch
from echogrid.can.motion import MotionReader
from echogrid.can.profile import load_motion, load_radar, shipped
from echogrid.can.radar import RadarReader
from echogrid.can.signals import SignalReader, buses_of
from echogrid.client import _json
from echogrid.config.loading import load_config
from echogrid.config.tables import Motion
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.health import Health, SensorHealth
from echogrid.errors import EchogridError
from echogrid.logs.drive import load_truth
from echogrid.logs.log import Log
from echogrid.maps import map_server
from echogrid.maps.dense_map import read_npz
from echogrid.model.network import OnnxSensorModel
from echogrid.pipeline import Pipeline
from echogrid.store.tile_store import TileStore
from echogrid.topics.diagnostic_array import decode_diagnostics
from echogrid.topics.grids import decode_grid, decode_update, encode_grid, encode_update
from echogrid.topics.points import decode_judged, decode_points, encode_judged, encode_points
from echogrid.topics.poses import decode_odometry, decode_pose, encode_odometry
from echogrid.zenoh.attachment import decode_attachment, decode_grid_attachment
from echogrid.zenoh.fleet import decompress
from tests.support import frames, networks

_TEMPORARY = tempfile.TemporaryDirectory(prefix="echogrid-fuzz-")
FOLDER = Path(_TEMPORARY.name)
LONGEST = 1 << 20  # messages that a small log may unpack to

Target = Callable[[bytes], None]


def _written(name: str, data: bytes) -> Path:
    path = FOLDER / name
    path.write_bytes(data)
    return path


def _without_checksums(name: str) -> str:
    """A shipped profile, less its checksums: no fuzzer guesses one, so that nothing behind it would ever be reached."""
    text = (shipped() / f"{name}.toml").read_text().replace(f'"{name}.dbc"', f'"{shipped() / f"{name}.dbc"}"')
    kept = [line for line in text.split("\n[crc]")[0].splitlines() if not line.startswith("crc =")]
    return "\n".join(kept) + "\n"


def _bus() -> Path:
    """A configuration with a radar of every shipped kind and the car's motion on one bus."""
    radars = ""
    for name, offset in (("corner_radar", 0), ("corner_radar_classic", 0x100), ("srr520", 0), ("ars408", 0)):
        _written(f"{name}.toml", _without_checksums(name).encode())
        radars += f'[[radar]]\nname = "{name}"\nbus = "can0"\nprofile = "{name}.toml"\nid_offset = {offset}\nx = 3.6\ny = 0\nyaw_deg = 0\n'
    _written("vehicle_motion.toml", _without_checksums("vehicle_motion").encode())
    head = frames.CONFIG.split("[[radar]]")[0].replace('bus = "can0"', 'bus = "can0"\nprofile = "vehicle_motion.toml"')
    return _written("bus.toml", (head + radars + "[grid]\ncells = 32\n").encode())


PARSED = tuple(map(functools.lru_cache(16), (signals.Dbc, signals.load_radar, radar._Layout)))  # none of these remembers anything


@contextmanager
def _parsed_once() -> Iterator[None]:
    """Profiles and DBC files, which takes far longer than all the rest; other tests in this process parse theirs anew."""
    own = signals.Dbc, signals.load_radar, radar._Layout
    signals.Dbc, signals.load_radar, radar._Layout = PARSED
    try:
        yield
    finally:
        signals.Dbc, signals.load_radar, radar._Layout = own


def _reader() -> SignalReader:
    with _parsed_once():
        return SignalReader(CONFIG, PATH, Health())


PATH = _bus()
CONFIG = load_config(PATH)
IDS = _reader().ids("can0")


def log(suffix: str) -> Target:
    """A recording of one format, through its reader and the decoding of signals; as many frames are told as are given."""

    def run(data: bytes) -> None:
        reader = _reader()
        log = Log(_written(f"a{suffix}", data))
        told = 0
        with suppress(EchogridError):
            for batch in log.batches():
                told += len(list(batch))
                assert [end for end, _ in reader.pieces(batch, buses_of(batch, CONFIG.bus))][-1] == len(batch)
                assert told < LONGEST, "a log without an end"
        assert log.messages == log.times.frames == told
        assert log.account.errors + log.account.remote <= log.messages

    return run


def frames_on_the_bus(data: bytes) -> None:
    """Frames of the ids that are read, as [id, milliseconds since the last, length, payload] over and over, into a map."""
    with _parsed_once():
        pipeline = Pipeline(CONFIG, PATH)
    batch = FrameBatch.of(list(_frames(data)))
    assert all(end <= len(batch) for end, _ in pipeline.take(batch, np.zeros(len(batch), np.int64)))
    pipeline.mapper.end_cycle()


def _frames(data: bytes) -> Iterator[can.Message]:
    at, time = 0, 1000.0
    while at + 3 <= len(data):
        which, wait, length = data[at : at + 3]
        identifier, extended = IDS[which % len(IDS)]
        time += wait * 1e-3
        payload = data[at + 3 : at + 3 + length % 65]
        yield can.Message(arbitration_id=identifier, is_extended_id=extended, data=payload, timestamp=time, is_fd=True)
        at += 3 + length % 65


def config(data: bytes) -> None:
    """A configuration with all that it names, but for the model."""
    with suppress(EchogridError), _parsed_once():
        path = _written("c.toml", data)
        Pipeline(load_config(path, "analytic"), path)


def dbc(data: bytes, name: str = "d.dbc") -> None:
    """A DBC file (or one in another format) under the shipped profiles, and the frames that it describes."""
    path = _written(name, data)
    for name in ("ars408", "corner_radar"):
        profile = FOLDER / f"{name}.toml"
        with suppress(EchogridError):
            _hear(RadarReader("radar", load_radar(profile), Dbc(path, profile), 0, SensorHealth()))
    profile = FOLDER / "vehicle_motion.toml"
    with suppress(EchogridError):
        _hear(MotionReader(load_motion(profile), Dbc(path, profile), Motion(bus="can0"), Health()))


def profile(data: bytes) -> None:
    """A profile for the shipped DBC files, and frames for what it asks for."""
    path = _written("p.toml", data)
    for name in ("ars408", "corner_radar"):
        with suppress(EchogridError):
            _hear(RadarReader("radar", load_radar(path), _dbc(name, path), 0, SensorHealth()))
    with suppress(EchogridError):
        _hear(MotionReader(load_motion(path), _dbc("vehicle_motion", path), Motion(bus="can0"), Health()))


def _dbc(name: str, path: Path) -> Dbc:
    return signals.Dbc(shipped() / f"{name}.dbc", path)


def _hear(reader: RadarReader | MotionReader) -> None:
    for fill in (b"\0", b"\xff", b"\x55"):
        for number, (identifier, extended) in enumerate(sorted(reader.ids)):
            message = can.Message(arbitration_id=identifier, is_extended_id=extended, data=fill * 64, is_fd=True)
            with suppress(ValueError):  # a frame that is unsound
                reader.add(message, number * 1_000_000)


def model(data: bytes) -> None:
    """An ONNX file."""
    with suppress(EchogridError):
        OnnxSensorModel(_written("m.onnx", data), GridSpec(cells=16, cell=0.5), {})


SOUND = networks.write(FOLDER / "sound.onnx", networks.paper()[0], None).read_bytes()


def contract(data: bytes) -> None:
    """The contract of an ONNX file that is otherwise sound: protobuf's fields may be appended, metadata_props is the 14th."""
    entry = b"\x0a\x08echogrid\x12" + _varint(len(data)) + data
    model(SOUND + b"\x72" + _varint(len(entry)) + entry)


def _varint(number: int) -> bytes:
    out = b""
    while number > 0x7F:
        out += bytes([number & 0x7F | 0x80])
        number >>= 7
    return out + bytes([number])


def truth(data: bytes) -> None:
    """A drive's true poses, as an .npz file."""
    with suppress(EchogridError):
        load_truth(_written("truth.npz", data))


def egmap(data: bytes) -> None:
    """A stored map, with every tile of every epoch. A -wal file beside it would be one that an input before has left."""
    path = _written("m.egmap", data)
    for left in FOLDER.glob("m.egmap-*"):
        left.unlink()
    with suppress(EchogridError), TileStore(path) as store:
        for epoch in store.epochs():
            for key in store.tiles(epoch.id)[:16]:
                store.read(epoch.id, key)


def npz(data: bytes) -> None:
    """A map as arrays."""
    with suppress(EchogridError):
        read_npz(_written("map.npz", data))


def yaml(data: bytes) -> None:
    """A map of ROS map_server over a sound picture."""
    _written("map.pgm", b"P5 2 2 255 \x00\xfe\xcd\x40")
    with suppress(EchogridError):
        map_server.read(_written("map.yaml", data))


def pgm(data: bytes) -> None:
    """The picture of a map of ROS map_server."""
    _written("picture.pgm", data)
    fields = "image: picture.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    with suppress(EchogridError):
        map_server.read(_written("sound.yaml", fields.encode()))


def wire(data: bytes) -> None:
    """What comes over Zenoh; what is taken goes back to the same bytes or at least to the same meaning."""
    with suppress(ValueError):
        grid = decode_grid(data)
        back = decode_grid(encode_grid(grid))
        assert (back.stamp_ns, back.frame, back.origin) == (grid.stamp_ns, grid.frame, grid.origin)
        assert (back.occupancy == grid.occupancy).all()
    with suppress(ValueError):
        odometry = decode_odometry(data)
        assert decode_odometry(encode_odometry(odometry)).stamp_ns == odometry.stamp_ns
    with suppress(ValueError):
        decode_pose(data)
    with suppress(ValueError):
        decode_diagnostics(data)
    with suppress(ValueError):
        update = decode_update(data)
        assert (decode_update(encode_update(update)).occupancy == update.occupancy).all()
    with suppress(ValueError):
        points = decode_points(data)
        assert (decode_points(encode_points(points)).points == points.points).all()
    with suppress(ValueError):
        judged = decode_judged(data)
        assert (decode_judged(encode_judged(judged)).verdicts == judged.verdicts).all()
    with suppress(ValueError):
        decompress(data)
    for attachment in (decode_attachment, decode_grid_attachment):
        with suppress(ValueError):
            attachment(data)
    with suppress(ValueError):
        _json(data)


TARGETS: dict[str, Target] = {
    "log": log(".log"),
    "log_gz": log(".log.gz"),
    "log_zst": log(".log.zst"),
    "asc": log(".asc"),
    "csv": log(".csv"),
    "trc": log(".trc"),
    "blf": log(".blf"),
    "db": log(".db"),
    "mcap": log(".mcap"),
    "pcap": log(".pcap"),
    "pcapng": log(".pcapng"),
    "frames": frames_on_the_bus,
    "config": config,
    "dbc": dbc,
    "kcd": functools.partial(dbc, name="d.kcd"),
    "sym": functools.partial(dbc, name="d.sym"),
    "arxml": functools.partial(dbc, name="d.arxml"),
    "profile": profile,
    "model": model,
    "contract": contract,
    "truth": truth,
    "egmap": egmap,
    "npz": npz,
    "yaml": yaml,
    "pgm": pgm,
    "wire": wire,
}
CORPUS = Path(__file__).parent / "corpus"


def corpus(name: str) -> list[Path]:
    """The inputs that are kept for a target: seeds, and what once made it fail."""
    return sorted((CORPUS / name).iterdir())


def any_of_them(data: bytes) -> None:
    """All targets as one: the first byte chooses."""
    if data:
        list(TARGETS.values())[data[0] % len(TARGETS)](data[1:])


def everything() -> list[bytes]:
    """The whole corpus as inputs of `any_of_them`."""
    return [struct.pack("B", number) + path.read_bytes() for number, name in enumerate(TARGETS) for path in corpus(name)]
