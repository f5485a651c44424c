"""The mended configuration: all fixes of a report, with the profiles that need some beside it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from echogrid.can.profile import find
from echogrid.commands.judged import Report
from echogrid.config.editing import Path as Keys
from echogrid.config.editing import edited
from echogrid.config.tables import Config
from echogrid.errors import EchogridError
from echogrid.files import read, whole
from echogrid.judging.mending import MOTION, POSE

MOST_BYTES = 1 << 20  # of a configuration or profile


def check_new(path: Path, option: str) -> None:
    """Raises EchogridError where something is there already."""
    if path.exists():
        raise EchogridError(f"{path}: is there already; give another {option}, or --force to replace it")


def write_mended(report: Report, source: Path, out: Path, *, force: bool) -> None:
    """The configuration with all fixes, and the profiles that need some beside it; what is left as it was keeps its comments.

    Raises EchogridError, and nothing is written, where one of the files is there already and is not to be replaced by `force`.
    """
    config = report.listener.config
    changes: dict[Keys, Any] = _moved(config, source.parent, out.parent)
    profiles: dict[str, dict[Keys, Any]] = {}
    for fix in report.fixes:
        changes |= fix.config
        for owner, own in fix.profiles.items():
            profiles.setdefault(owner, {}).update(own)
    written: dict[tuple[str, str], str] = {}
    texts: dict[str, str] = {}  # by file name
    for owner, own in profiles.items():
        index = None if owner in (MOTION, POSE) else [radar.name for radar in config.radar].index(owner)
        configured = config.radar[index] if index is not None else config.pose if owner == POSE else config.motion
        assert configured is not None  # what is mended is configured
        table: Keys = (owner,) if index is None else ("radar", index)
        profile = find(str(configured.profile), source.parent)
        kind = profile.stem, repr(own)
        if kind not in written:
            same = sum(stem == profile.stem for stem, _ in written)
            written[kind] = f"{out.stem}_{profile.stem}{same + 1 if same else ''}.toml"
            texts[written[kind]] = edited(read(profile, MOST_BYTES).decode("utf-8-sig"), own)
        changes[*table, "profile"] = written[kind]
        mender = report.listener.mender
        of = mender.radars[owner] if index is not None else mender.pose if owner == POSE else mender.motion
        described = None if of is None else of.dbc
        if configured.dbc is None and described is not None:
            changes[*table, "dbc"] = relative_to(out.parent, profile.parent / described)
    texts[out.name] = edited(read(source, MOST_BYTES).decode("utf-8-sig"), changes)
    for name in () if force else texts:
        check_new(out.parent / name, "--fix-out")
    for name, text in texts.items():
        with whole(out.parent / name) as partial:
            partial.write_text(text)


def _moved(config: Config, before: Path, after: Path) -> dict[Keys, Any]:
    """The relative paths of a configuration that is written into another folder."""
    if before.resolve() == after.resolve():
        return {}
    named: dict[Keys, str | None] = {("motion", "dbc"): config.motion.dbc, ("motion", "profile"): config.motion.profile}
    for n, radar in enumerate(config.radar):
        named |= {("radar", n, "dbc"): radar.dbc, ("radar", n, "profile"): radar.profile}
    if config.pose is not None:
        named |= {("pose", "dbc"): config.pose.dbc, ("pose", "profile"): config.pose.profile}
    named[("model",)] = config.model
    return {
        path: relative_to(after, before / name)
        for path, name in named.items()
        if name is not None and name.endswith((".toml", ".dbc", ".onnx"))
    }


def relative_to(folder: Path, path: Path) -> str:
    """Relative where both lie in one tree, else absolute."""
    relative = os.path.relpath(path.resolve(), folder.resolve())
    return str(path.resolve()) if relative.startswith("..") else relative
