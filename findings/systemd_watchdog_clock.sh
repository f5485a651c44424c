#!/bin/sh
# systemd-watchdog's ping goes by the wall clock: once that is set back, no ping goes out until it has caught up, and systemd ends the service.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet systemd-watchdog==1.0.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import datetime
import os
import socket
import time
from importlib.metadata import version
from unittest import mock

import systemd_watchdog

# systemd.service: WatchdogSec= counts on the monotonic clock. An ECU's wall clock is set when it first hears the time.
listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
listener.bind("notify")
listener.settimeout(0)
os.environ.update(NOTIFY_SOCKET="notify", WATCHDOG_USEC="1000000")


class SetBack(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return datetime.datetime.now(tz) - datetime.timedelta(hours=1)


def heard():
    try:
        return listener.recv(100).decode().strip()
    except BlockingIOError:
        return None


seen = {}
for name, clock in (("clock left alone", datetime.datetime), ("clock set back by an hour", SetBack)):
    watchdog = systemd_watchdog.WatchDog()
    first = watchdog.ping(), heard()
    time.sleep(0.7)  # more than half of what systemd allows
    with mock.patch("systemd_watchdog.systemd_watchdog.datetime", clock):
        seen[name] = first, (watchdog.ping(), heard())
    print(f"systemd-watchdog {version('systemd-watchdog')}, {name}: first ping {seen[name][0]}, after 0.7 s of 1 s {seen[name][1]}")
sent = True, "WATCHDOG=1"
assert seen == {"clock left alone": (sent, sent), "clock set back by an hour": (sent, (False, None))}
PYTHON
