"""The documents name every key and signal that there is."""

from __future__ import annotations

import re
from pathlib import Path

import cantools
import msgspec
import pytest

from echogrid.can.profile import MotionProfile, PoseProfile, RadarProfile
from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.judging.finding import CODES
from echogrid.topics.topic import ALIVE, FLEET, REGION, RUN, TILE, TOPICS
from tests.support.places import ROOT


def keys(kind: object) -> set[str]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return {field.encode_name for field in msgspec.structs.fields(kind)} | set().union(
            *(keys(field.type) for field in msgspec.structs.fields(kind))
        )
    return set().union(*(keys(inner) for inner in getattr(kind, "__args__", ())))


@pytest.mark.parametrize(
    ("document", "kind"),
    [("docs/configuration.md", Config), ("dbc/README.md", RadarProfile), ("dbc/README.md", MotionProfile), ("dbc/README.md", PoseProfile)],
)
def test_every_key_is_explained(document: str, kind: type) -> None:
    text = (ROOT / document).read_text()
    assert {key for key in keys(kind) if not re.search(rf"\b{key}\b", text)} == set()


def test_every_code_of_a_check_is_explained() -> None:
    rows = re.findall(r"(?m)^\| (`.*?) \|", (ROOT / "docs" / "checking.md").read_text())
    assert {code for row in rows for code in re.findall(r"`(\w+)`", row)} >= set(CODES)


@pytest.mark.parametrize("path", sorted((ROOT / "dbc").glob("*.dbc")), ids=lambda path: path.name)
def test_every_signal_is_in_the_table_with_its_unit(path: Path) -> None:
    text = (ROOT / "dbc" / "README.md").read_text().split(f"### {path.name}")[1].split("###")[0]
    for message in cantools.database.load_file(path).messages:
        for signal in message.signals:
            name = re.sub(r"_\d+$", "_{k}", signal.name)
            assert re.search(rf"\| `{re.escape(name)}` \| {re.escape(signal.unit or '1')} \| {signal.scale:g} \|", text), name


def test_the_configuration_to_start_from_is_sound() -> None:
    path = ROOT / "deploy" / "echogrid.toml"
    config = load_config(path)
    assert len(SignalReader(config, path, Health()).ids("radars")) == 8


def test_every_topic_is_in_the_interface_with_its_type_and_its_name_under_ros() -> None:
    text = (ROOT / "docs" / "interface.md").read_text()
    rows = re.findall(r"(?m)^\| `([\w/]+)[^`|]*` \| ([^|]*) \|[^|]*\| (?:`(\S+)` )?\|$", text)
    told = {name: (re.findall(r"`(\w+/msg/\w+)`|(JSON) object", payload), ros or None) for name, payload, ros in rows}
    ours = {topic.name: ([(topic.type or "", "" if topic.type else "JSON")], topic.ros) for topic in (*TOPICS, FLEET)}
    assert told == ours | {ALIVE: ([], None), f"{RUN}/": ([], None), REGION: ([], None), f"{TILE}/": ([], None)}
    (kept,) = re.findall(r"Of (.*?) the last sample is kept", text)
    assert set(re.findall(r"`(\w+)`", kept)) == {topic.name.rpartition("/")[2] for topic in TOPICS if topic.kept}


def test_every_topic_of_ros_is_in_the_interface_with_its_quality_of_service() -> None:
    text = (ROOT / "docs" / "interface.md").read_text().split("| topic | reliability, durability, depth |")[1].split("\n\n")[0]
    told = {}
    for names, durability, depth in re.findall(r"(?m)^\| (.*) \| reliable, (volatile|transient local), (\d+)", text):
        told |= {name: (durability == "transient local", int(depth)) for name in re.findall(r"`(\S+)`", names)}
    assert told == {topic.ros: (topic.kept, topic.depth) for topic in TOPICS if topic.ros is not None}
