#!/bin/sh
# small-mcap gives the messages of an MCAP file neither in their order of time nor in that of the file where one is late; backwards it sorts them.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0 small-mcap==0.16.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import small_mcap
from mcap.reader import make_reader
from mcap.writer import Writer

# Two radars into one file, as they come in; the left one's second scan was measured before what has been written already.
written = [("left", 1), ("right", 2), ("left", 5), ("right", 6), ("left", 3), ("right", 7)]
with open("a.mcap", "wb") as file:
    writer = Writer(file)
    writer.start(profile="", library="")
    schema = writer.register_schema("scan", "jsonschema", b"{}")
    channels = {name: writer.register_channel(name, "json", schema) for name in ("left", "right")}
    for name, time in written:
        writer.add_message(channels[name], log_time=time, publish_time=time, data=b"{}")
    writer.finish()


def times(messages):
    return [message.log_time for _, _, message in messages]


with open("a.mcap", "rb") as file:
    theirs = times(make_reader(file).iter_messages())
    forwards = times(small_mcap.read_message(file))
    backwards = times(small_mcap.read_message(file, reverse=True))
print(f"in the file {[time for _, time in written]}; mcap {version('mcap')}: {theirs}")
print(f"small-mcap {version('small-mcap')}: {forwards}, backwards {backwards}")
assert theirs == [1, 2, 3, 5, 6, 7] and backwards == theirs[::-1]
assert sorted(forwards) == theirs and forwards not in (theirs, [time for _, time in written])
PYTHON
