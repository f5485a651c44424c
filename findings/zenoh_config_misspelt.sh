#!/bin/sh
# Zenoh refuses a misspelt key in its configuration, but not where a publisher's priority or a connection's retries are set: there it is dropped.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
cd "$folder"
venv/bin/python - <<'PYTHON'
import json
from importlib.metadata import version

from zenoh import Config, ZError

# Each key as it is right, and with its last letter doubled; the path to where it is read back.
said = {
    "timestamping": ("timestamping", "enabled", True, "{timestamping: {KEY: true}}"),
    "qos/network": ("qos/network", "messages", ["put"], '{qos: {network: [{KEY: ["put"], key_exprs: ["map"], overwrite: {}}]}}'),
    "qos/network's overwrite": (
        "qos/network", "priority", "real_time",
        '{qos: {network: [{messages: ["put"], key_exprs: ["map"], overwrite: {KEY: "real_time"}}]}}',
    ),
    "qos/publication": (
        "qos/publication", "priority", "real_time",
        '{qos: {publication: [{key_exprs: ["map"], config: {KEY: "real_time"}}]}}',
    ),
    "connect/retry": ("connect/retry", "period_init_ms", 250, "{connect: {retry: {KEY: 250}}}"),
}
refused = []
for where, (path, key, value, text) in said.items():
    right = Config.from_json5(text.replace("KEY", key)).get_json(path)
    assert f'"{key}":{json.dumps(value)}' in right
    try:
        wrong = Config.from_json5(text.replace("KEY", key + key[-1])).get_json(path)
    except ZError as error:
        print(f"{where}, {key + key[-1]}: refused, {str(error).partition(',')[0]}")
        refused.append(where)
    else:
        print(f"{where}, {key + key[-1]}: taken, and read back as {wrong}")
        assert f'"{key}":null' in wrong and key + key[-1] not in wrong
print(f"eclipse-zenoh {version('eclipse-zenoh')}: refused in {refused}")
assert refused == ["timestamping", "qos/network"]
PYTHON
