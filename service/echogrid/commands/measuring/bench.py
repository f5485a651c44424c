"""`echogrid bench`: what each part of an update takes on this machine, and what the whole comes to."""

from __future__ import annotations

import json
import os
import platform
import time
from dataclasses import asdict
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.commands.measuring.floors import floors
from echogrid.commands.measuring.loops import paces, seen
from echogrid.commands.measuring.stages import stages
from echogrid.commands.terminal import progress
from echogrid.core.kernels.dispatch import WHY
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.logs.log import check_rereadable

COARSEST = 0.0005  # s
FLAGS = ("avx2", "avx_vnni", "avx512_vnni", "amx_int8", "asimddp", "i8mm")  # of processors, by which int8 is fast


def command(path: Path | None, config: Path | None, model: str | None, seconds: float, *, as_json: bool) -> None:
    """Of a drive folder, or a log with its configuration; None: the shipped drive. Raises EchogridError for what cannot be read, and where
    processor time cannot be."""
    check_clock()
    drive = find_drive(path or Path(str(files("echogrid") / "demo_drive")), config)
    check_rereadable(drive.log)
    with progress("bench") as advance:
        found = stages(drive, model, seconds, advance)
        best = floors()
        loops = paces(seen(drive, (model or "default",)))
    figures: dict[str, Any] = {
        "machine": machine(),
        "kernels": WHY,
        **asdict(found),
        "cycle_ms": found.cycle_ms,
        "unheard_ms": found.unheard_ms,
        "cycle_by_inference": None if found.inference_ms is None else found.cycle_ms / found.inference_ms,
        "share_of_a_core": found.cycle_ms * found.rate_hz / 1e3,
        "floors": best,
        "loops": {name: pace._asdict() for name, pace in loops.items()},
    }
    if as_json:
        print(json.dumps(figures))
        return
    print("\n".join(report(figures)))


def check_clock() -> None:
    """Raises EchogridError where a thread's processor time goes on in such steps as some kernels count it by, one tick or none a loop."""
    times = [time.thread_time()]
    while len(times) < 3:  # the first step may have begun before
        if (now := time.thread_time()) > times[-1]:
            times.append(now)
    if (step := times[2] - times[1]) > COARSEST:
        said = "bench: a thread's processor time goes on in steps of %.0f ms on this kernel, loops take some microseconds"
        raise EchogridError(said % (step * 1e3))


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    try:
        words = set(Path("/proc/cpuinfo").read_text().split())
    except OSError:
        words = set()
    return {
        "architecture": platform.machine(),
        "cores": os.cpu_count(),
        "flags": [flag for flag in FLAGS if flag in words],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "onnxruntime": version("onnxruntime"),
    }


def report(figures: dict[str, Any]) -> list[str]:
    """In words."""
    here, cycle, inference, best = figures["machine"], figures["cycle_ms"], figures["inference_ms"], figures["floors"]
    lines = [
        f"machine: {here['architecture']}, {here['cores']} cores{''.join(f', {flag}' for flag in here['flags'])}; Python {here['python']}, "
        f"numpy {here['numpy']}, onnxruntime {here['onnxruntime']}",
        f"kernels: {figures['kernels']}",
        f"model: {figures['model']}",
        "",
        f"processor time of a map update with its frames, ms, mean of {figures['updates']}:",
    ]
    lines += [f"  {stage:<44}{spent:8.3f}{spent / cycle:7.0%}" for stage, spent in figures["per_update_ms"].items()]
    lines += [f"  {'whole cycle':<44}{cycle:8.3f}", f"  {'while nobody takes its messages, at most':<44}{figures['unheard_ms']:8.3f}", ""]
    if inference is not None:
        million = best["multiply_adds_millions_per_s"] * inference / 1e3
        lines.append(f"an inference takes {inference:.2f} ms, in which this core does {million:.0f} million multiply-adds at best")
        unheard = figures["unheard_ms"] / inference
        lines.append(f"a whole cycle takes {figures['cycle_by_inference']:.2f} times as long as an inference, unheard {unheard:.2f} times")
    lines.append(f"a whole cycle takes as long as copying {best['copied_mib_per_s'] * cycle / 1e3:.0f} MiB")
    lines.append(
        f"at {figures['rate_hz']:.1f} updates a second that is {figures['share_of_a_core']:.1%} of a core, without receiving and sending"
    )
    if figures["loops"]:
        lines += ["", "loops, compiled and in numpy, µs a call:"]
        for name, pace in figures["loops"].items():
            lines.append(f"  {name:<16}{pace['compiled_us']:9.1f}{pace['numpy_us']:9.1f}{pace['ratio']:8.2f} x")
    return lines
