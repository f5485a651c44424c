"""What a signal is, by the words of its name and by its unit: a DBC says no more."""

from __future__ import annotations

import re
from itertools import pairwise

from echogrid.can.database import Signal

TOKEN = re.compile(r"[A-ZÄÖÜ]+(?![a-zäöü])|[A-ZÄÖÜ]?[a-zäöü]+|\d+")
# Units as DBC files write them, lower case and without blanks, by the profile's word for them.
UNITS = {
    "m": ("m", "meter", "meters", "metre", "metres", "unit_meter"),
    "cm": ("cm", "unit_centimeter", "centimeter"),
    "m/s": ("m/s", "mps", "m/sec", "ms^-1", "m*s^-1", "meters/sec", "meter/s", "unit_meterpersecon", "unit_meterpersecond"),
    "km/h": ("km/h", "kmh", "kph", "km^h", "kmph", "unit_kilometerperhour"),
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "°", "degree", "degrees", "grad", "unit_degreofarc", "\ufffd"),
    "rad/s": ("rad/s", "rad/sec", "radians/second", "rps"),
    "deg/s": (
        "deg/s", "°/s", "deg/sec", "degree/s", "degrees/s", "degrees/second", "grad/s", "deg/sek", "unit_degreofarcpersecon",
        "unit_degreepersecond", "\ufffd/s",
    ),
    "rpm": ("rpm", "1/min", "u/min", "min^-1"),
    "dBsm": ("dbsm", "dbm2", "dbm^2", "dbm²", "db"),
    "s": ("s", "sec", "second", "seconds"),
    "ms": ("ms", "msec", "unit_millisecon"),
    "us": ("us", "µs", "usec"),
    "%": ("%", "percent", "unit_percen"),
}  # fmt: skip
UNIT_OF = {written: unit for unit, ways in UNITS.items() for written in ways}
RATE = {"rate", "rt", "rte", "vel", "velocity", "speed", "spd", "v", "vr", "vrad", "vrel", "rrate", "doppler", "dot", "geschw", "rangerate"}
LENGTH = {"range", "rng", "rge", "dist", "distance", "radius", "abstand", "r", "d", "pos", "position", "rad"}
ANGLE = {"azimuth", "azi", "az", "azim", "azm", "azmth", "angle", "ang", "agl", "phi", "bearing", "brg", "winkel", "theta", "alpha"}
LONG = {"long", "lon", "longitudinal", "lgt", "x", "dx", "laengs"}
LATERAL = {"lat", "lateral", "y", "dy", "quer"}
ALONG, ACROSS = {"vx", "vlong", "vlon", "vrellong"}, {"vy", "vlat", "vrellat"}
ECHO = {"rcs", "amplitude", "ampl", "amp", "power", "pwr", "magnitude", "mag", "snr", "intensity", "reflectivity"}
NO_VALUE = {
    "acc", "accel", "acceleration", "a", "sigma", "std", "stddev", "var", "rms", "err", "error", "quality", "conf", "confidence", "prob",
    "width", "height", "len", "length", "elevation", "elev", "el", "z", "dz", "vz", "orientation", "heading", "id", "mode", "type", "class",
    "age", "bias", "offset", "stat", "status", "qf", "qbit", "max", "min", "unambiguous", "ambiguity", "ambig", "interval", "resolution",
    "steering", "lenkradw", "steer",
}  # fmt: skip
VALID = {"valid", "validity", "vld", "val", "exist", "exists", "present", "flag", "gueltig"}
COUNT = {"count", "cnt", "num", "nof", "number", "no", "nr", "anzahl", "n", "dets", "points"}
CHECKSUM = {"crc", "checksum", "chksum", "chk", "cs", "cksum", "pruefsumme"}
AGE = {"age", "latency", "delay", "meas", "alter"}
REAR = {"r", "rear", "re", "h", "b", "back", "hinten"}
LEFT, RIGHT = {"l", "left", "le", "lt", "links"}, {"r", "right", "ri", "rt", "rechts"}
FRONT = {"f", "front", "fr", "v", "vorn", "vorne"}
WHEEL = {"wheel", "whl", "wheels", "rad", "radgeschw", "radgeschwindigkeit", "wss"}
WHEEL_RATE = RATE | {"w", "omega", "rot", "radgeschw", "radgeschwindigkeit", "wss"}
YAW = {"yaw", "gier", "gierrate", "psi", "psip", "yawrate", "giergeschw"}
YAW_RATE = {"rate", "rt", "rte", "w", "speed", "spd", "vel", "velocity", "gierrate", "psip", "yawrate", "giergeschw", "dot"}


def tokens(name: str) -> list[str]:
    """The words of a name in lower case, numbers of their own: CAN_DET_RANGE_01, DetRange01."""
    return [found.lower() for found in TOKEN.findall(name)]


def unit_of(signal: Signal) -> str | None:
    """The profile's word for the unit of a signal; None where the file names none that is known."""
    return UNIT_OF.get(re.sub(r"\s+", "", signal.unit.lower()).replace("unit_kilometreperhour", "unit_kilometerperhour"))


def detection_role(signal: Signal) -> str | None:
    """Which quantity of a detection it is: range, azimuth, range_rate, x, y, vx, vy, rcs or valid; None: none of them."""
    said = set(tokens(signal.name))
    joined = "".join(word for word in tokens(signal.name) if not word.isdecimal())
    unit = unit_of(signal)
    if said & (VALID - {"val"}) or (said & {"val"} and signal.length == 1):
        return "valid" if signal.length <= 4 else None
    if said & NO_VALUE or signal.length < 3:
        return None
    rated = bool(said & RATE) or any(word in joined for word in ("rangerate", "relspeed", "relvel", "vrel", "radialvel"))
    if unit in ("m/s", "km/h") or (unit is None and (rated or said & (ALONG | ACROSS))):
        if said & (LATERAL | ACROSS) or "vrellat" in joined:
            return "vy"
        return "vx" if said & (LONG | ALONG) or "vrellong" in joined else "range_rate"
    if unit in ("m", "cm") or (unit is None and (said & LENGTH or said & {"dx", "dy", "x", "y"} or "dist" in joined)):
        return "y" if said & LATERAL or "distlat" in joined else "x" if said & LONG or "distlong" in joined else "range"
    if unit in ("rad", "deg") or (unit is None and said & ANGLE):
        return "azimuth"
    return "rcs" if said & ECHO and unit in (None, "dBsm") else None


def wheel_of(signal: Signal, message: str = "") -> str | None:
    """rear_left, rear_right, or "speed" for one speed of the whole car; None where it is no speed of those. A `message` whose name says
    that it has the wheels' may call them RL and RR."""
    words = tokens(signal.name)
    said, unit = set(words), unit_of(signal)
    if unit not in (None, "m/s", "km/h", "rad/s", "rpm") or signal.length < 8 or said & (NO_VALUE - {"a", "z", "val"}) - {"v"}:
        return None
    corner = corner_of(signal.name)
    if unit and set(tokens(message)) & WHEEL and said <= CORNERS.keys() | REAR | LEFT | RIGHT:
        return corner if corner in ("rear_left", "rear_right") else None
    if not said & WHEEL_RATE and not (said & WHEEL and unit):
        return None
    if said & WHEEL or "wheel" in "".join(words):
        return corner if corner in ("rear_left", "rear_right") else None
    vehicle = said & {"vehicle", "veh", "car", "fzg", "ego", "speed", "velocity", "geschw"}
    return "speed" if vehicle and unit in (None, "m/s", "km/h") and corner is None and not said & (YAW | {"engine", "eng", "fan"}) else None


def is_yaw_rate(signal: Signal) -> bool:
    """Whether it is the car's turn rate."""
    said, unit = set(tokens(signal.name)), unit_of(signal)
    if (
        signal.length < 8
        or unit not in (None, "rad/s", "deg/s")
        or said & (NO_VALUE - {"z", "no"})
        or said & {"trlr", "trailer", "rq", "req"}
    ):
        return False
    turning = bool(said & YAW) or (bool(said & {"gyro", "omega", "angular"}) and "z" in said)
    return turning and (unit is not None or bool(said & YAW_RATE))


def is_count(signal: Signal) -> bool:
    """Whether its name says that it counts detections."""
    said = set(tokens(signal.name))
    return bool(said & COUNT) and not said & {"cycle", "alive", "rolling", "seq", "sequence", "msg", "message"} and 3 <= signal.length <= 16


def is_checksum(signal: Signal) -> bool:
    return bool(set(tokens(signal.name)) & CHECKSUM) and signal.length in (8, 16, 32)


def is_age(signal: Signal) -> bool:
    """Whether it is the time from the measurement to the frame."""
    return bool(set(tokens(signal.name)) & AGE) and unit_of(signal) in ("s", "ms", "us")


def is_ambiguity(signal: Signal) -> bool:
    """Whether it is the Doppler ambiguity interval, or its half."""
    said = tokens(signal.name)
    return any("ambig" in word for word in said) and unit_of(signal) in ("m/s", "km/h")


def is_blockage(signal: Signal) -> bool:
    return any(word.startswith("block") or word == "blind" for word in tokens(signal.name)) and unit_of(signal) == "%"


def is_direction(signal: Signal) -> bool:
    """Whether it says that the car goes back."""
    said = set(tokens(signal.name))
    return bool(said & {"direction", "dir", "reverse", "rev", "gear", "fahrtrichtung", "rueckwaerts"}) and signal.length <= 4


def corner_of(name: str) -> str | None:
    """front_left and so on, where a name says so: FL, RearRight, vorn_links, HL; None where it does not."""
    words = [word for word in tokens(name) if not word.isdecimal()]
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if word in ("rr", "fr") and after in ("l", "r"):  # "Rr" and "Fr" are the ends then
            return f"{'rear' if word == 'rr' else 'front'}_{'left' if after == 'l' else 'right'}"
        if word in CORNERS:
            return CORNERS[word]
    for one, other in pairwise(words):
        for pair in ((one, other), (other, one)):
            end = "rear" if pair[0] in REAR - {"r", "b"} or pair == ("r", "l") else "front" if pair[0] in FRONT - {"v"} else None
            side = "left" if pair[1] in LEFT else "right" if pair[1] in RIGHT else None
            if end and side:
                return f"{end}_{side}"
    ends = {"rear" for word in words if word in {"rear", "hinten", "back"}} | {
        "front" for word in words if word in {"front", "vorn", "vorne"}
    }
    sides = {"left" for word in words if word in LEFT - {"l", "le", "lt"}} | {
        "right" for word in words if word in RIGHT - {"r", "ri", "rt"}
    }
    return f"{ends.pop()}_{sides.pop()}" if len(ends) == len(sides) == 1 else None


CORNERS = {
    f"{end}{side}": f"{'front' if end in 'fv' else 'rear'}_{'left' if side == 'l' else 'right'}" for end in "fvrhb" for side in "lr"
} | {"lf": "front_left", "rf": "front_right", "lr": "rear_left"}
