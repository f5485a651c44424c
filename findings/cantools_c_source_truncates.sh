#!/bin/sh
# The C encoders that cantools generates cut off where cantools itself rounds: every third speed of 0.1 m/s steps is one step low.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import subprocess
import sys

import cantools

text = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 291 M: 8 A
 SG_ range : 0|16@1+ (0.01,0) [0|655.35] "m" A
 SG_ speed : 16|12@1- (0.1,0) [-204.8|204.7] "m/s" A
"""
open("a.dbc", "w").write(text)
subprocess.run([sys.executable, "-m", "cantools", "generate_c_source", "a.dbc"], check=True, capture_output=True)
# The doubles that a program has for 0.01 m, 0.02 m, ... and for -204.8 m/s, -204.7 m/s, ...
main = """#include <stdio.h>
#include "a.h"
int main(void) {
    for (int raw = 0; raw < 65536; raw++) printf("%d ", a_m_range_encode(raw / 100.0));
    for (int raw = -2048; raw < 2048; raw++) printf("%d ", a_m_speed_encode(raw / 10.0));
    return 0;
}
"""
open("main.c", "w").write(main)
subprocess.run(["cc", "-O0", "-o", "a.out", "main.c", "a.c"], check=True)
found = [int(word) for word in subprocess.run(["./a.out"], check=True, capture_output=True, text=True).stdout.split()]
expected = list(range(65536)) + list(range(-2048, 2048))
wrong = [one != other for one, other in zip(found, expected, strict=True)]
message = cantools.database.load_string(text, "dbc").messages[0]
python = [message.encode({"range": raw / 100, "speed": 0}) != raw.to_bytes(8, "little") for raw in range(65536)]
seen = sum(wrong[:65536]), sum(wrong[65536:]), sum(python)
print(
    f"cantools {cantools.__version__}: its C source encodes {seen[0]} of 65536 ranges and {seen[1]} of 4096 speeds one step off: "
    f"0.29 m as {found[29]} (0.01 m), -0.3 m/s as {found[65536 + 2045]} (0.1 m/s); its Python encodes {seen[2]} ranges so"
)
assert seen == (8628, 1434, 0) and found[29] == 28 and found[65536 + 2045] == -2
PYTHON
