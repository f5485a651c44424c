"""A configuration file, read and checked: what is wrong with it is one sentence."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
from can.interfaces import VALID_INTERFACES

from echogrid.config.endpoint import exposed, nowhere, stays_here
from echogrid.config.tables import NAMED, Config, Publish
from echogrid.config.toml import load
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import MOST_RADARS, most_tiles_along
from echogrid.errors import EchogridError
from echogrid.files import meant, never, surely

BUMPER = 0.2  # m: how far outside the outline a radar may sit, behind a bumper


def load_config(path: Path, model: str | None = None) -> Config:
    """Reads and checks a configuration file; `model` overrides its own, relative to the working folder.

    Raises EchogridError with one sentence that names the file and the key.
    """
    config = load(path, Config)
    if model is not None:
        _check_model(model)
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


def remarks(config: Config) -> list[str]:
    """What a configuration names and nothing needs, one sentence each."""
    needless = (bus.name for bus in config.bus if bus not in config.read_buses)
    return [f"bus '{name}': no radar, no [motion] and no [pose] is on it, so a service does not open it" for name in needless]


def _check_model(model: str) -> None:
    """What was typed, so that the file's own key is not blamed."""
    if model not in NAMED and not model.endswith(".onnx"):
        raise EchogridError(f"--model: {_no_model(model)}")
    if model not in NAMED and not surely(Path(model).is_file):
        raise EchogridError(f"--model: {model}: there is no such file{meant(Path(model))}")


def _no_model(model: str) -> str:
    return f"'{model}' found, expected {', '.join(NAMED)}, or the path of an .onnx file{_near(model, NAMED)}"


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
    for index, bus in enumerate(config.bus):
        if bus.interface not in VALID_INTERFACES:
            guess = _near(bus.interface, VALID_INTERFACES)
            yield f"bus[{index}].interface: '{bus.interface}' found, expected one that python-can knows, such as socketcan{guess}"
        for other in config.bus[:index]:
            if bus.logged_as == other.logged_as or (bus.interface, bus.channel) == (other.interface, other.channel):
                own = "expected channels of their own, in recordings too (log_channel)"
                yield f"bus[{index}]: '{bus.name}' and '{other.name}' are both channel '{other.logged_as}', {own}"
    fastest = 1e3 / config.map.cycle_ms
    if config.publish.rate_hz > fastest * (1 + 1e-9) and config.publish.rate_hz != Publish().rate_hz:  # the default asks for no more
        rate, cycle = config.publish.rate_hz, config.map.cycle_ms
        yield f"publish.rate_hz: {rate:g} found, expected at most {fastest:g}: the map is updated every map.cycle_ms = {cycle:g}"
    if config.motion.bus not in buses:
        yield f"motion.bus: no [[bus]] is named '{config.motion.bus}', found {known}"
    if config.model not in NAMED and not config.model.endswith(".onnx"):
        yield f"model: {_no_model(config.model)}"
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
    elif config.metrics.listen is not None and not config.metrics.plaintext and not stays_here(f"tcp/{config.metrics.listen}"):
        yield f"metrics.listen: '{config.metrics.listen}' leaves this machine unprotected, expected the loopback, or plaintext = true"
    file = config.metrics.file
    if file is not None and not (file.startswith("/") and file.endswith(".prom")):
        yield f"metrics.file: '{file}' found, expected an absolute path that ends in .prom, as node_exporter reads no other"
    if config.store.path is not None and surely(Path(config.store.path).is_dir):
        yield f"store.path: {config.store.path} is a folder, expected the name of a file in it, such as map.egmap"
    elif config.store.path is not None and (why := never(Path(config.store.path))) is not None:
        yield f"store.path: {config.store.path} cannot be the name of a file: {why}"
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
    yield from _about_pose(config, buses)
    if config.publish.tls is not None and config.publish.plaintext:
        yield "publish.plaintext: found beside [publish.tls], expected one of them"
    for key, endpoints in (("listen", config.publish.listen), ("connect", config.publish.connect)):
        for endpoint in endpoints:
            problem = nowhere(endpoint) or exposed(endpoint, config.publish)
            if problem is not None:
                yield f"publish.{key}: '{endpoint}' {problem}"


def _about_pose(config: Config, buses: list[str]) -> Iterator[str]:
    pose, tls = config.pose, config.publish.tls is not None
    if pose is None:
        return
    if (pose.bus is None) == (pose.key is None):
        yield f"pose: {'neither' if pose.bus is None else 'both'} bus and key found, expected one: a CAN bus, or a key of Zenoh"
    elif pose.key is None:
        if pose.bus not in buses:
            yield f"pose.bus: no [[bus]] is named '{pose.bus}', found {', '.join(buses)}{_near(str(pose.bus), buses)}"
        if pose.profile is None:
            yield "pose.profile: is missing, expected the path of a profile that ends in .toml"
        if pose.senders:
            yield "pose.senders: found beside bus, expected beside key: CAN has no certificates"
    else:
        extra = next((name for name in ("profile", "dbc", "origin") if getattr(pose, name) is not None), None)
        if extra is not None:
            yield f"pose.{extra}: found beside key, expected beside bus: over Zenoh a pose is an Odometry in metres"
        if tls and not pose.senders:
            yield "pose.senders: is missing, expected the common names in the certificates of those who may send, as [publish.tls] is given"
        if pose.senders and not tls:
            yield "pose.senders: found without [publish.tls], expected with it: without certificates nobody has a name"


def _near(name: str, known: Iterable[str]) -> str:
    """The end of a sentence about a name that is none: the known one that it is nearly, or nothing."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""
