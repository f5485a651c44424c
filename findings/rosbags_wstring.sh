#!/bin/sh
# rosbags takes a message definition with a wstring, and raises KeyError when such a message is first written or read.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg("wstring name\n", "a/msg/A"))
try:
    seen = bytes(store.serialize_cdr(store.types["a/msg/A"](name="radar"), "a/msg/A")).hex()
except KeyError as error:
    seen = f"KeyError: {error}"
print(f"rosbags {version('rosbags')}: registered without a word; written: {seen}")
assert seen == "KeyError: 'a/msg/wstring'"
PYTHON
