#!/bin/sh
# zenoh.ext's z_deserialize takes the first bytes of what was serialised as another type and drops the rest, where Rust's refuses it; an int has 32 bits.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from zenoh.ext import Float32, Int16, Int64, UInt8, ZDeserializeError, z_deserialize, z_serialize

cases = {
    "300 as UInt8": (300, UInt8),
    "an Int64 of 2**40 + 5 as int": (Int64(2**40 + 5), int),
    "a float of 5.0 as Float32": (5.0, Float32),
    "[1, 2] as list[Int16]": ([1, 2], list[Int16]),
    "a list of two texts as str": (["a", "b"], str),
    "1 as Int64": (1, Int64),
}
seen = {}
for name, (value, kind) in cases.items():
    try:
        seen[name] = z_deserialize(kind, z_serialize(value))
    except ZDeserializeError:
        seen[name] = "ZDeserializeError"
    print(f"eclipse-zenoh {version('eclipse-zenoh')}: {name}: {seen[name]!r}")
try:
    stamp = z_serialize(1_600_000_000_000_000_000)  # ns
except OverflowError as error:
    stamp = f"OverflowError: {error}"
print(f"a time in ns as int: {stamp}")
assert list(seen.values()) == [44, 5, 0.0, [1, 0], "\x01a", "ZDeserializeError"] and f"{stamp}".startswith("OverflowError")
PYTHON
