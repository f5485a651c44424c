"""A Linux guest with SocketCAN, on a machine whose own kernel has none: User-Mode Linux, one ordinary process.

    python -m tests.rig.guest [--systemd] COMMAND...      the guest's answer on stdout, the command's exit status

The guest's root is this machine's, read-only, under an overlay in memory: every program is there at its own path, and what is
written is gone afterwards. The command runs as root in the caller's folder and environment. Needs `linux.uml`, and a C compiler on a
processor with AMX.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

INIT = Path(__file__).with_name("guest-init")
WHOLE_STATE = Path(__file__).with_name("whole_state.c")
PR_SET_PDEATHSIG = 1


@dataclass(frozen=True, slots=True)
class Answer:
    """`status` is None where the guest did not come up, died, or its time was up; `output` then ends with its console."""

    status: int | None
    output: str


def missing(cpuinfo: Path = Path("/proc/cpuinfo")) -> str | None:
    """Why this machine can boot none; None where it can."""
    if shutil.which("linux.uml") is None:
        return "there is no User-Mode Linux, which 'make test-rig' installs"
    if has_amx(cpuinfo) and shutil.which("cc") is None:
        return "User-Mode Linux 6.1 panics at start on a processor with AMX, and there is no C compiler for what helps it"
    return None


def has_amx(cpuinfo: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether this processor has."""
    return "amx_tile" in cpuinfo.read_text().split()


def run(command: list[str], *, systemd: bool = False, timeout: float = 300, memory: str = "2G") -> Answer:
    """Boots a guest, runs the command in it and powers it off. `systemd`: as its PID 1, the command being its last service."""
    with tempfile.TemporaryDirectory(prefix="rig.") as name:
        shared = Path(name)  # what guest-init reads and writes
        environment = "".join(f"export {key}={shlex.quote(value)}\n" for key, value in os.environ.items() if key.isidentifier())
        (shared / "command").write_text(f"{environment}cd {shlex.quote(str(Path.cwd()))} || exit\n{shlex.join(command)}\n")
        (shared / "output").touch()
        with (shared / "console").open("wb") as console:
            _boot(shared, console.fileno(), systemd, memory, timeout)
        output = (shared / "output").read_text(errors="replace")
        status = shared / "status"
        if status.exists():
            return Answer(int(status.read_text()), output)
        return Answer(None, f"{output}\n== the guest's console\n{(shared / 'console').read_text(errors='replace')[-8000:]}")


def _boot(shared: Path, console: int, systemd: bool, memory: str, timeout: float) -> None:
    core = max(os.sched_getaffinity(0))

    def in_child() -> None:
        # The guest has one processor, and each of its system calls goes to and fro between two processes: faster on one core.
        os.sched_setaffinity(0, {core})
        with suppress(PermissionError):  # and where each of these turns had to wait behind busy neighbours, a bus could not keep its pace
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)  # it ends with us, whatever ends us

    kernel = ["linux.uml", f"mem={memory}", "rootfstype=hostfs", "rootflags=/", "ro", f"init={INIT}", f"uml_dir={shared}/", "quiet"]
    kernel += ["con=null", f"con0=null,fd:{console}", "noreboot", "panic=-1", "selinux=0", "systemd.show_status=0"]
    kernel += [f"RIG={shared}", f"RIG_SYSTEMD={'yes' if systemd else ''}"]
    environment = dict(os.environ)
    if has_amx():
        environment["LD_PRELOAD"] = str(shared / "whole_state.so")
        subprocess.run(["cc", "-O2", "-fPIC", "-shared", str(WHOLE_STATE), "-o", environment["LD_PRELOAD"]], check=True)
    process = subprocess.Popen(
        kernel,
        stdin=subprocess.DEVNULL,
        stdout=console,
        stderr=console,
        pass_fds=(console,),
        start_new_session=True,
        preexec_fn=in_child,
        env=environment,
    )
    try:
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests.rig.guest", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systemd", action="store_true", help="systemd as PID 1")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args()
    if (lack := missing()) is not None:
        sys.exit(f"tests.rig.guest: {lack}")
    answer = run(arguments.command, systemd=arguments.systemd)
    sys.stdout.write(answer.output)
    sys.exit(125 if answer.status is None else answer.status)


if __name__ == "__main__":
    main()
