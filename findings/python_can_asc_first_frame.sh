#!/bin/sh
# python-can's ASCReader loses the first frame of an ASC file whose head has no line on internal events.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

frames = "".join(f"0.0{n}0000 1 10{n} Rx d 1 00\n" for n in range(4))
counts = {}
for head in ("base hex  timestamps absolute\nno internal events logged\n", "base hex  timestamps absolute\n"):
    open("a.asc", "w").write(head + frames)
    counts[head] = [message.arbitration_id for message in can.ASCReader("a.asc")]
    print(f"python-can {can.__version__}: {len(counts[head])} of 4 frames behind the head {head!r}")
assert [len(ids) for ids in counts.values()] == [4, 3]
PYTHON
