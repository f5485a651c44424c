"""Builds a release into dist: `make release`, or `python -m release.build` with an interpreter that has requirements/build.txt.

The wheels are built from the sdist, unpacked elsewhere: what is missing in it shows, and nothing in the checkout changes.
SOURCE_DATE_EPOCH is the commit's time, so the same commit gives the same bytes with the same compiler.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from release.version import NOT_RELEASED, ROOT, ReleaseError, debian, git, head_of, version


def main() -> None:
    parser = argparse.ArgumentParser(description="sdist, wheels, requirements, changes and checksums of this checkout, into a folder")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="may hold this version's Debian package (default: dist)")
    parser.add_argument("--sbom", type=Path, help="the parts that the service is made of: goes with the rest")
    given = parser.parse_args()
    try:
        build(given.out, given.sbom)
    except ReleaseError as error:
        sys.exit(f"release: {error}")


def build(out: Path, sbom: Path | None = None) -> list[Path]:
    """All files of the release. Raises ReleaseError."""
    number = version()
    sound(number)
    if "SOURCE_DATE_EPOCH" not in os.environ and (ROOT / ".git").exists():
        os.environ["SOURCE_DATE_EPOCH"] = git(ROOT, "log", "-1", "--format=%ct")
    out.mkdir(parents=True, exist_ok=True)
    built = [*packages(out), hatch(ROOT / "training", "wheel", out)]
    pinned, changes = out / f"echogrid-{number}-requirements.txt", out / f"echogrid-{number}-changes.md"
    shutil.copyfile(ROOT / "requirements" / "service.txt", pinned)
    changes.write_text(section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), head_of(ROOT)[0]), encoding="utf-8")
    built += [pinned, changes, *out.glob(f"echogrid_{debian(number)}_*.deb")]
    if sbom is not None:
        built.append(out / f"echogrid-{number}.cdx.json")
        shutil.copyfile(sbom, built[-1])
    sums = out / f"echogrid-{number}-SHA256SUMS"
    sums.write_text("".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in sorted(built)))
    return [*built, sums]


def sound(number: str) -> None:
    """A version that was tagged is the one that the changelog says was released."""
    head, date = head_of(ROOT)
    if re.fullmatch(r"\d+\.\d+\.\d+", number) and (number != head or date == NOT_RELEASED):
        raise ReleaseError(f"CHANGELOG.md: its head is '{head}, {date}' and the tag v{number}, expected '{number}' and the date")


def packages(out: Path) -> list[Path]:
    """The service's sdist, its wheel without compiled kernels, and the one with them."""
    sdist = hatch(ROOT, "sdist", out)
    with tempfile.TemporaryDirectory(prefix="echogrid-") as folder:
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        source = Path(folder) / sdist.name.removesuffix(".tar.gz")
        pure = hatch(source, "wheel", out, ECHOGRID_KERNELS="numpy")
        compiled = hatch(source, "wheel", out, ECHOGRID_KERNELS="")
    if compiled == pure:
        raise ReleaseError("the compiled kernels are missing: a C compiler and Python.h (python3-dev) are needed")
    return [sdist, pure, compiled]


def hatch(source: Path, target: str, out: Path, **own: str) -> Path:
    """One package of a source tree."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(out.resolve())]
    done = subprocess.run(command, cwd=source, env=os.environ | own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseError(f"{source}: no {target}: {done.stderr.strip()}")
    *warnings, name = done.stderr.strip().splitlines()
    sys.stderr.write("".join(f"{line}\n" for line in warnings))
    return out / Path(name).name


def section(changelog: str, number: str) -> str:
    """What a changelog says of one version, with its head."""
    found = re.search(rf"^## {re.escape(number)},.*?(?=^## |\Z)", changelog, re.MULTILINE | re.DOTALL)
    if found is None:
        raise ReleaseError(f"CHANGELOG.md: says nothing of {number}")
    return found[0].rstrip() + "\n"


if __name__ == "__main__":
    main()
