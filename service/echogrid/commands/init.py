"""`echogrid init`: from a recording, and the DBCs that there are, to a configuration, its profiles, and what is uncertain or missing."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from echogrid.can.dbc import Dbc
from echogrid.commands.judged import Report, check_log
from echogrid.commands.terminal import part, progress
from echogrid.config.loading import load_config
from echogrid.errors import EchogridError
from echogrid.files import check_file, whole
from echogrid.logs.log import Log, check_rereadable
from echogrid.surveying.heard import Channel, Heard
from echogrid.surveying.proposal import Proposal, propose
from echogrid.surveying.senders import Source
from echogrid.surveying.survey import Survey, survey

ROUNDS = 3  # of checking and mending
HEARD = 0.25  # of the whole: reading it the first time
CONFIDENT = 0.8
# What a check may mend here: the rest needs a person.
MENDED = frozenset(
    (
        *("speed_sign", "speed_unit", "speed_scale", "wheel_scale", "yaw_rate_sign", "yaw_rate_unit", "yaw_rate_bias"),
        *("azimuth_unit", "range_unit", "range_rate_unit", "mount_yaw", "mount_x", "mount_y", "time_offset", "field_of_view"),
    )
)


def command(log: Path, dbcs: Sequence[Path], out: Path, *, force: bool, as_json: bool) -> bool:
    """Writes the configuration and its profiles; returns whether a check accepts it and nothing is missing.

    Raises EchogridError where a file cannot be read or is there already.
    """
    check_file(out, ".toml")
    if out.exists() and not force:
        raise EchogridError(f"{out}: is there already; give another --out, or --force to replace it")
    check_rereadable(log)
    sources = [Source(path, Dbc(path, path).database) for path in dbcs]
    with progress(f"init {log.name}") as advance:
        heard, torn = _heard(log, part(advance, 0.0, HEARD))
        found = survey(heard.channels, sources)
        proposal = propose(found, log, out.parent, out.stem)
        report = _mended(proposal, log, part(advance, HEARD, 1.0)) if proposal.motion is not None and proposal.radars else None
    texts = proposal.files(out.name, out.parent)
    there = [name for name in texts if (out.parent / name).exists()]
    if there and not force:
        raise EchogridError(f"{out.parent / there[0]}: is there already; give another --out, or --force to replace it")
    for name, text in texts.items():
        with whole(out.parent / name) as partial:
            partial.write_text(text)
    unused = _unused(sources, _read_by(found, proposal), heard)
    accepted = report is not None and not report.findings and not proposal.missing
    if as_json:
        document = _document(found, proposal, report, [out.parent / name for name in texts])
        print(json.dumps(document | {"unused": unused, "accepted": accepted}, indent=2))
    else:
        print("".join(f"not used: {line}\n" for line in unused), end="")
        print("\n".join(_told(found, proposal, report, log, out, list(texts))))
    if torn is not None:
        raise torn
    return accepted


def _read_by(found: Survey, proposal: Proposal) -> list[Path]:
    """The DBCs that the written files name."""
    given = [*(radar.sender.dbc for radar in found.radars), None if found.motion is None else found.motion.dbc]
    return [*(draft.dbc for draft in proposal.drafts.values()), *(path for path in given if path is not None)]


def _unused(sources: Sequence[Source], named: Collection[Path], heard: Heard) -> list[str]:
    """The DBCs that are not named, and what the recording has of them."""
    said, files = [], {path.resolve() for path in named}
    for source in sources:
        if source.path.resolve() in files:
            continue
        ids = {(message.frame_id, message.is_extended_frame) for message in source.database.messages}
        there = sum(any(channel.counts[one] for channel in heard.channels) for one in ids)
        some = f"{there} of its {len(ids)} messages are in the recording, and neither a radar nor motion is read by them"
        said.append(f"{source.path}: {some if there else 'none of its messages is in the recording'}")
    return said


def _heard(log: Path, advance: Callable[[float], None]) -> tuple[Heard, EchogridError | None]:
    """All that can be read, and what is wrong with the file."""
    heard, recording = Heard(), Log(log)
    try:
        for batch in recording.batches():
            for message in batch:
                heard.add(message)
            advance(recording.progress)
    except EchogridError as error:
        if not recording.messages:
            raise
        return heard, error
    return heard, None


def _mended(proposal: Proposal, log: Path, advance: Callable[[float], None]) -> Report:
    """What a check says of the proposal once it has been mended by what a check says."""
    for number in range(ROUNDS):
        last = number == ROUNDS - 1
        with tempfile.TemporaryDirectory(prefix="echogrid-") as folder:
            for name, text in proposal.files("echogrid.toml", Path(folder)).items():
                (Path(folder) / name).write_text(text)
            source = Path(folder) / "echogrid.toml"
            report = check_log(load_config(source), source, log, part(advance, number / ROUNDS, (number + 1) / ROUNDS))
        fixes = [
            (finding, fix)
            for finding, fix in zip(report.findings, report.fixes, strict=True)
            if finding.code in MENDED and finding.confidence >= CONFIDENT and (fix.config or fix.profiles)
        ]
        if last or not fixes:
            return report
        for finding, fix in fixes:
            proposal.mend(fix, f"by a check of the recording, {finding.code}, {finding.confidence:.0%} sure")
    raise AssertionError


def _document(found: Survey, proposal: Proposal, report: Report | None, files: Sequence[Path]) -> dict[str, Any]:
    """The same for programs; docs/new_car.md names the keys."""
    judgement = None if report is None else report.judgement
    return {
        "files": [str(path) for path in files],
        "radars": {
            radar.mount.name: {
                "profile": radar.sender.profile,
                "channel": radar.sender.channel.name,
                "scans": len(radar.sender.scans),
                "whole": round(radar.sender.share, 4),
            }
            for radar in found.radars
        },
        "motion": None if found.motion is None else {"profile": found.motion.profile, "channel": found.motion.channel.name},
        "uncertain": proposal.uncertain(),
        "missing": proposal.missing,
        "findings": [] if report is None else [{"code": one.code, "sentence": one.sentence} for one in report.findings],
        "undecided": [] if judgement is None else [{"code": one.code, "sentence": one.sentence} for one in judgement.undecided],
    }


def _channel(channel: Channel) -> str:
    """A name as it is, and a number with what it counts."""
    return f"channel {channel.name}" if isinstance(channel.name, int) else channel.name or "the only channel"


def _told(found: Survey, proposal: Proposal, report: Report | None, log: Path, out: Path, names: Sequence[str]) -> list[str]:
    """What was found, what is uncertain, what is missing and what a check still says."""
    lines = []
    for radar in found.radars:
        sender = radar.sender
        what = sender.profile or f"the DBC's {sender.draft.tables['detections']['messages'] if sender.draft else ''}"
        channel, shift = _channel(sender.channel), f", ids {sender.shift:+#x}" if sender.shift else ""
        lines.append(f"radar {radar.mount.name}: {what} on {channel}{shift}: {len(sender.scans)} scans, {sender.share:.0%} of them whole")
    if found.motion is not None:
        wheels, turning = found.motion.messages
        lines.append(f"motion: {found.motion.profile or f'{wheels} and {turning} of the DBC'} on {_channel(found.motion.channel)}")
    uncertain = proposal.uncertain()
    if not found.signs.sure and found.first_bend is not None:
        time, degrees = found.first_bend
        side = "left" if degrees > 0 else "right"
        lines.append(
            f"left and right: by this configuration the first bend is at {time:.0f} s, {abs(degrees):.0f}° to the {side}. "
            "If the car went the other way, turn the signs of yaw_rate and azimuth (or y and vy) in the profiles, and of all y and yaw_deg"
        )
    lines += ["", f"uncertain, and marked in the files ({len(uncertain)}):", *(f"  {line}" for line in uncertain)] if uncertain else []
    lines += [f"missing: {line}" for line in proposal.missing]
    if report is not None:
        lines += [f"check still says [{one.code}] {one.sentence}" for one in report.findings]
        lines += [f"not judged [{one.code}]: {one.sentence}" for one in report.judgement.undecided]
    lines += ["", f"written: {', '.join(str(out.parent / name) for name in names)}"]
    if report is None:
        lines.append(f"{out}: is not complete yet")
    elif any(fix.config or fix.profiles for fix in report.fixes):
        lines.append(f"{out}: a check does not accept it yet; it says what would mend it: echogrid check -c {out} {log}")
    elif report.findings:
        lines.append(f"{out}: what a check still says is of the recording or the radars; no line of the configuration mends it")
    else:
        lines.append(f"a check accepts it. Next: measure what is uncertain, then echogrid check -c {out} {log}")
    return lines
