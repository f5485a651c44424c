#!/bin/sh
# vblf cannot read python-can's CAN FD frames in BLF nor its unpacked files; python-can cannot read what vblf writes by default.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet vblf==0.3.1
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import can
from vblf.can import CanMessage
from vblf.constants import Compression, ObjFlags
from vblf.reader import BlfReader
from vblf.writer import BlfWriter


def theirs(fd, level):
    with can.BLFWriter("a.blf", compression_level=level) as writer:
        writer.on_message_received(can.Message(timestamp=1.6e9, arbitration_id=1, is_extended_id=False, is_fd=fd, data=b"12", channel=0))
    try:
        with BlfReader("a.blf") as reader:
            return [type(found).__name__ for found in reader]
    except Exception as error:  # of struct, of zlib
        return f"{type(error).__module__}.{type(error).__name__}: {error}"


def ours(level):
    with BlfWriter("b.blf", compression_level=level) as writer:
        writer.write(CanMessage.new(ObjFlags.TIME_ONE_NANS, 0, 1, 0, 2, 1, b"12".ljust(8, b"\0")))
    try:
        return [message.arbitration_id for message in can.BLFReader("b.blf")]
    except Exception as error:
        return f"{type(error).__module__}.{type(error).__name__}: {error}"


seen = {"classic": theirs(False, -1), "FD": theirs(True, -1), "classic, unpacked": theirs(False, 0)}
back = {"packed": ours(Compression.DEFAULT), "unpacked, vblf's default": ours(Compression.NONE)}
print(f"vblf {version('vblf')} reads of python-can {can.__version__}: {seen}")
print(f"python-can {can.__version__} reads of vblf {version('vblf')}: {back}")
assert seen["classic"] == ["CanMessage"] and seen["FD"].startswith("struct.error") and seen["classic, unpacked"].startswith("zlib.error")
assert back["packed"] == [1] and back["unpacked, vblf's default"].startswith("zlib.error")
PYTHON
