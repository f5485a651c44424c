"""A survey as files: the configuration and its profiles, with a remark at every line that is a guess."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from echogrid.config.editing import literal
from echogrid.judging.mending import Fix
from echogrid.surveying.drafts import Draft, seen_from, unread_checksums
from echogrid.surveying.heard import Channel
from echogrid.surveying.senders import MotionSender
from echogrid.surveying.survey import Survey

UNCERTAIN = "  # uncertain: "


@dataclass(slots=True)
class Table:
    """One table of the configuration; `remarks` by key: why the line is uncertain."""

    values: dict[str, Any]
    remarks: dict[str, str] = field(default_factory=dict)

    def lines(self) -> list[str]:
        return [
            f"{key} = {literal(value)}" + (UNCERTAIN + self.remarks[key] if key in self.remarks else "")
            for key, value in self.values.items()
        ]


@dataclass(slots=True)
class Proposal:
    """Remembers the tables, which a check then mends; `drafts` by the names of their files."""

    about: list[str]
    buses: list[Table]
    motion: Table | None
    radars: list[Table]
    drafts: dict[str, Draft]
    missing: list[str]

    def files(self, name: str, folder: Path) -> dict[str, str]:
        """Texts by file name, the configuration's under `name`, for this folder: paths of DBCs are as seen from there."""
        lines = [f"# {line}" for line in self.about]
        for missing in self.missing:
            lines.append(f"# missing: {missing}")
        for bus in self.buses:
            lines += ["", "[[bus]]", *bus.lines()]
        lines += ["", "[motion]", *self.motion.lines()] if self.motion is not None else ["", "# [motion] is missing"]
        for radar in self.radars:
            lines += ["", "[[radar]]", *radar.lines()]
        texts = {name: "\n".join(lines) + "\n"}
        for file, draft in self.drafts.items():
            texts[file] = draft.text(["As `echogrid init` found it in a DBC and a recording. Keys: dbc/README.md."], folder)
        return texts

    def mend(self, fix: Fix, why: str) -> None:
        """Takes over the lines of a fix; of profiles, those that are ours."""
        for path, value in fix.config.items():
            table = self.motion if path[0] == "motion" else self.radars[int(path[1])] if path[0] == "radar" else self.buses[int(path[1])]
            if table is not None:
                table.values[str(path[-1])] = value
                table.remarks[str(path[-1])] = why
        by_name = {str(radar.values["name"]): radar for radar in self.radars}
        for owner, changes in fix.profiles.items():
            table = by_name.get(owner, self.motion)
            draft = None if table is None else self.drafts.get(str(table.values["profile"]))
            for (section, key, part), value in changes.items():
                if draft is None:
                    break
                draft.tables[str(section)][str(key)][str(part)] = value
                draft.remarks[str(section), str(key)] = why

    def uncertain(self) -> list[str]:
        """All remarks, with their places."""
        tables = [*self.buses, *([self.motion] if self.motion else []), *self.radars]
        said = [f"{table.values.get('name', '[motion]')}: {key}: {why}" for table in tables for key, why in table.remarks.items()]
        for file, draft in self.drafts.items():
            said += [f"{file}: {'.'.join(key)}: {why}" for key, why in draft.remarks.items()]
        return said


def propose(survey: Survey, log: Path, folder: Path, stem: str) -> Proposal:
    """For a configuration in that folder. `stem`: what the profiles' names begin with."""
    missing = _missing(survey)
    names = {channel.name: f"can{n}" for n, channel in enumerate(survey.channels)}
    buses = [_bus(channel, names[channel.name]) for channel in survey.channels]
    drafts: dict[str, Draft] = {}
    files: dict[int, str] = {}
    for draft in survey.drafts.values():
        if id(draft) not in files:
            files[id(draft)] = f"{stem}_radar{len(files) + 1 if len(survey.drafts) > 1 else ''}.toml"
            drafts[files[id(draft)]] = draft
    for draft in survey.skeletons:
        drafts[f"{stem}_{draft.kind}.toml"] = draft
    motion = None
    if survey.motion is not None:
        motion = _motion(survey.motion, names, survey.radius, folder)
        if survey.motion.draft is not None:
            motion.values["profile"] = f"{stem}_motion.toml"
            drafts[f"{stem}_motion.toml"] = survey.motion.draft
    radars = []
    for radar in survey.radars:
        sender, mount = radar.sender, radar.mount
        profile = sender.profile or files[id(sender.draft)]
        values: dict[str, Any] = {"name": mount.name, "bus": names[sender.channel.name], "profile": profile}
        if sender.dbc is not None:
            values["dbc"] = seen_from(folder, sender.dbc)
        values |= {"id_offset": sender.shift, "x": mount.x, "y": mount.y, "yaw_deg": mount.yaw_deg, "fov_deg": radar.fov_deg}
        remarks = {"x": mount.about_place, "y": mount.about_place}
        if mount.about_yaw:
            remarks["yaw_deg"] = mount.about_yaw
        radars.append(Table(values, remarks))
    about = [f"Made by `echogrid init {log.name}`. Lines that say uncertain are guesses: measure them.", "Keys: docs/configuration.md."]
    return Proposal(about, buses, motion, radars, drafts, missing)


def _bus(channel: Channel, name: str) -> Table:
    """As python-can would name it, where the recording's name or number says so."""
    if isinstance(channel.name, int):
        values: dict[str, Any] = {"name": name, "channel": f"can{max(channel.name - 1, 0)}", "fd": channel.fd, "log_channel": channel.name}
        return Table(values, {"channel": f"the recording numbers it {channel.name}; interface and channel are those of the car's computer"})
    if not channel.name:
        return Table({"name": name, "channel": "can0", "fd": channel.fd}, {"channel": "the recording does not say channels"})
    return Table({"name": name, "channel": channel.name, "fd": channel.fd})


def _motion(sender: MotionSender, names: Mapping[str | int, str], radius: float | None, folder: Path) -> Table:
    table = Table({"bus": names[sender.channel.name], "profile": sender.profile or ""})
    if sender.dbc is not None:
        table.values["dbc"] = seen_from(folder, sender.dbc)
    if radius is not None:
        table.values["wheel_radius"] = radius
        table.remarks["wheel_radius"] = "m, by Doppler where the radars tell it; measure it"
    return table


def _missing(survey: Survey) -> list[str]:
    """What a configuration needs and the recording or the DBCs do not give."""
    said = []
    have = {draft.kind: draft.heard for draft in survey.skeletons}
    for kind, there, what, like, none in (
        ("motion", survey.motion is not None, "wheel speeds and yaw rate", "them", "no ego motion"),
        ("radar", bool(survey.radars), "radars", "detections with range, azimuth and range rate", "no whole scans"),
    ):
        if there:
            continue
        if kind in have:
            why = "but the recording has no frames that fit"
            if names := have[kind]:
                more = f" and {len(names) - 1} more" if len(names) > 1 else ""
                why = f"and the recording has frames of '{names[0]}'{more}, but {none} can be made of them"
            said.append(f"{what}: the DBC has signals like {like}, {why}; a skeleton of the profile is written")
        else:
            said.append(
                f"{what}: no message of the DBCs or of a shipped profile looks like {like}; "
                "give the DBC that has them, and a recording of its bus"
            )
    unread: dict[str, None] = {}
    for sender in (radar.sender for radar in survey.radars):
        if sender.group is not None and sender.shape is not None:
            unread |= dict.fromkeys(unread_checksums(sender.group, sender.shape)[:1])
    said += [f"the algorithm of {name}: no known one fits, so frames are taken unchecked (crc in dbc/README.md)" for name in unread]
    return said
