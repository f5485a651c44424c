#!/bin/sh
# The mcap package cannot read what its own writer makes with repeat_channels or repeat_schemas off, which the format allows.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import io
from importlib.metadata import version

from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer

# The MCAP specification: copies of the schema and channel records in the summary section are optional.
seen = {}
for off in ("nothing", "repeat_channels", "repeat_schemas", "use_statistics"):
    file = io.BytesIO()
    writer = Writer(file, **({} if off == "nothing" else {off: False}))
    writer.start()
    channel = writer.register_channel("/a", "json", writer.register_schema("a", "jsonschema", b"{}"))
    writer.add_message(channel, log_time=1, publish_time=1, data=b"{}")
    writer.finish()
    for reader in (make_reader, NonSeekingReader):
        try:
            found = len(list(reader(io.BytesIO(file.getvalue())).iter_messages()))
        except KeyError as error:
            found = f"KeyError: {error}"
        seen.setdefault(off, []).append(found)
    print(f"mcap {version('mcap')}: {off} off: make_reader gives {seen[off][0]} of 1 message, NonSeekingReader {seen[off][1]}")
assert seen == {"nothing": [1, 1], "repeat_channels": ["KeyError: 1", 1], "repeat_schemas": ["KeyError: 1", 1], "use_statistics": [1, 1]}
PYTHON
