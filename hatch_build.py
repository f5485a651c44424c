"""Builds the compiled kernels (service/echogrid/core/kernels/compiled.c) into the package, where a C compiler is at hand.

Without one, or with ECHOGRID_KERNELS=numpy, the package has numpy alone and the service says so.
`python hatch_build.py` builds them in this checkout.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
import zlib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = Path("service/echogrid/core/kernels/compiled.c")
BUILT = SOURCE.with_suffix(".abi3.so")
# No product fused with a sum: the same bits as numpy's, on every processor. Sine and cosine one by one, as Python's math asks for them.
BITS = ("-ffp-contract=off", "-fno-builtin-sin", "-fno-builtin-cos")
FLAGS = ("-std=c11", "-O3", *BITS, "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared", "-Wall", "-Wextra")


def build(root: Path) -> str | None:
    """Compiles into a checkout; what is wrong where that cannot be done, and then nothing is left of an older build."""
    (root / BUILT).unlink(missing_ok=True)
    include = sysconfig.get_paths()["include"]
    if not (Path(include) / "Python.h").is_file():
        return f"Python.h is not in {include}: on Debian it is in python3-dev"
    compiler = shlex.split(os.environ.get("CC", "cc"))
    built_from = f"-DBUILT_FROM={zlib.crc32(b''.join(path.read_bytes() for path in sorted((root / SOURCE).parent.glob('*.[ch]'))))}"
    flags = [*FLAGS, built_from, *shlex.split(os.environ.get("CFLAGS", "")), f"-I{include}"]
    command = [*compiler, *flags, str(SOURCE), "-o", str(BUILT), "-lm"]
    try:
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    except OSError as error:
        return f"there is no C compiler: {compiler[0]}: {error.strerror}"
    return None if done.returncode == 0 else f"{compiler[0]} failed: {done.stderr.strip()}"


class KernelsHook(BuildHookInterface[Any]):
    """For wheels and for the installation of a checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Says so where there is no compiled kernel, and goes on."""
        if os.environ.get("ECHOGRID_KERNELS") == "numpy":
            return
        why = build(Path(self.root))
        if why is not None:
            self.app.display_warning(f"echogrid runs without compiled kernels, slower: {why}")
            return
        build_data["artifacts"].append(str(BUILT))
        if version != "editable":
            build_data["pure_python"] = False
            build_data["tag"] = f"cp311-abi3-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


if __name__ == "__main__":
    sys.exit(build(Path(__file__).parent))
