#!/bin/sh
# PyYAML reads a number such as 5e-2, the resolution of a map's YAML file, as a text, and 010 as 8; ruamel.yaml, by YAML 1.2, as 0.05 and 10.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet PyYAML==6.0.4
"$folder/venv/bin/pip" install --quiet ruamel.yaml==0.19.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import ruamel.yaml
import yaml

text = "image: map.pgm\nresolution: 5e-2\norigin: [-12.0, 010, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 1.96e-1\n"
keys = ("resolution", "origin", "free_thresh")
seen = {}
for name, document in (("PyYAML", yaml.safe_load(text)), ("ruamel.yaml", ruamel.yaml.YAML(typ="safe").load(text))):
    seen[name] = [document[key] for key in keys]
print(f"PyYAML {version('PyYAML')}, ruamel.yaml {version('ruamel.yaml')}: {', '.join(keys)} of a map: {seen}")
assert seen == {"PyYAML": ["5e-2", [-12.0, 8, 0.0], 0.196], "ruamel.yaml": [0.05, [-12.0, 10, 0.0], 0.196]}
PYTHON
