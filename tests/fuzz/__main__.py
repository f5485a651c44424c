"""python -m tests.fuzz [TARGET ...] [--seconds N]: coverage-guided fuzzing of each target in turn, from the corpus on.

New inputs go to out/fuzz/TARGET. One that makes a target fail, hang for 30 s or take 2 GiB goes to out/fuzz, and that target has failed.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"
OUT = Path("out/fuzz")
ALL = "all"  # every target in one process, one after the other at random: for a short look


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Coverage-guided fuzzing with atheris.")
    parser.add_argument(
        "targets", nargs="*", default=sorted(path.name for path in CORPUS.iterdir()), metavar="TARGET", help=f"default: each; or '{ALL}'"
    )
    parser.add_argument("--seconds", type=int, default=180, help="for each (default: 180)")
    arguments = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in arguments.targets:
        print(f"== {name}", flush=True)
        child = os.fork()  # libFuzzer ends its process; nothing that begins threads is imported before
        if child == 0:
            fuzz(name, arguments.seconds)
        if os.waitpid(child, 0)[1]:
            failed.append(name)
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


def fuzz(name: str, seconds: int) -> None:
    """Never returns; the process ends with an error where an input was found."""
    import atheris

    atheris.enabled_hooks.add("str")
    with atheris.instrument_imports(include=["echogrid", "can.io", "mcap", "cantools", "textparser", "tomllib"]):
        from tests.fuzz import targets
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    # atheris keeps what strings it has compared: 1 GiB in minutes, where the reader of ASC itself grew by 7 MiB in 29,000 inputs
    limits = [f"-max_total_time={seconds}", "-timeout=30", "-rss_limit_mb=2048", "-max_len=32768", f"-artifact_prefix={OUT}/{name}-"]
    options = [sys.argv[0], *limits, "-print_final_stats=1"]
    if name == ALL:
        seeds = Path(tempfile.mkdtemp(prefix="echogrid-seeds-"))
        for number, data in enumerate(targets.everything()):
            (seeds / str(number)).write_bytes(data)
        atheris.Setup([*options, str(seeds)], targets.any_of_them)
    else:
        (OUT / name).mkdir(exist_ok=True)
        atheris.Setup([*options, str(OUT / name), str(targets.CORPUS / name)], targets.TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
