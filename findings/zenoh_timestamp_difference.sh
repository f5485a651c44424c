#!/bin/sh
# Zenoh's Timestamp.get_diff_duration of a time and a later one is 136 years less the difference: a message that comes 1 s early is 136 years old.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
cd "$folder"
venv/bin/python - <<'PYTHON'
from datetime import UTC, datetime, timedelta
from importlib.metadata import version

import zenoh

# A receiver's clock and a sender's that is ahead of it by a second.
name = zenoh.TimestampId(b"\x01")
receiver, sender = (zenoh.Timestamp(datetime(2020, 9, 13, 12, 26, second, tzinfo=UTC), name) for second in (40, 41))
assert receiver < sender
later, earlier = sender.get_diff_duration(receiver), receiver.get_diff_duration(sender)
print(f"eclipse-zenoh {version('eclipse-zenoh')}: the later less the earlier {later}, the earlier less the later {earlier}")
print(f"their get_time()s: {receiver.get_time() - sender.get_time()}")
assert later == timedelta(seconds=1) and receiver.get_time() - sender.get_time() == -timedelta(seconds=1)
assert earlier == timedelta(seconds=2**32 - 1)
PYTHON
