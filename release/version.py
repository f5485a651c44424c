"""The version of this checkout: `python release/version.py [--debian]`.

A commit that a tag vX.Y.Z names is version X.Y.Z. Any other is between versions: the head of CHANGELOG.md says which, and the time
and the hash of the commit follow, so a clone without tags, or with a part of the history, has a version too. X.Y.Z.dev… comes before
X.Y.Z, which is not released; X.Y.Z.post… after it. Files without git have the head of the changelog alone.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOT_RELEASED = "not released"


class ReleaseError(Exception):
    """One sentence on what a release cannot be made of."""


def version(root: Path = ROOT) -> str:
    """As PEP 440 has it. Raises ReleaseError."""
    number, date = head_of(root)
    between = f"{number}.{'dev' if date == NOT_RELEASED else 'post'}"
    try:
        if not (root / ".git").exists():  # what is around may be another project's
            return f"{between}0"
        tags = [tag.removeprefix("v") for tag in git(root, "tag", "--points-at", "HEAD").split() if re.fullmatch(r"v\d+\.\d+\.\d+", tag)]
        commit, time = git(root, "log", "-1", "--format=%H %cd", "--date=format-local:%Y%m%d%H%M%S").split()
        changed = bool(git(root, "status", "--porcelain", "--untracked-files=no"))
    except ReleaseError as error:
        sys.stderr.write(f"version: {error}; so this one is called {between}0\n")
        return f"{between}0"
    if tags and not changed:
        return max(tags, key=lambda tag: [int(part) for part in tag.split(".")])
    return f"{between}{time}+g{commit[:9]}" + (".changed" if changed else "")


def debian(number: str) -> str:
    """As Debian has it, for which ~ comes before."""
    return number.replace(".dev", "~dev")


def head_of(root: Path) -> tuple[str, str]:
    """The newest version in the changelog, and the date of its release or NOT_RELEASED. Raises ReleaseError."""
    path = root / "CHANGELOG.md"
    found = re.search(rf"^## (\d+\.\d+\.\d+), (\d{{4}}-\d\d-\d\d|{NOT_RELEASED})$", path.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise ReleaseError(f"{path}: has no head such as '## 1.2.3, 2026-01-31' or '## 1.2.3, {NOT_RELEASED}'")
    return found[1], found[2]


def git(root: Path, *arguments: str) -> str:
    """What it answers. Raises ReleaseError."""
    own = os.environ | {"TZ": "UTC", "LC_ALL": "C"}
    try:
        done = subprocess.run(["git", *arguments], cwd=root, env=own, capture_output=True, text=True, check=False)
    except OSError:
        raise ReleaseError("git, which knows more, is not installed") from None
    if done.returncode:
        raise ReleaseError(f"git {arguments[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


if __name__ == "__main__":
    sys.stdout.write((debian(version()) if sys.argv[1:] == ["--debian"] else version()) + "\n")
